"""The compiled root finder against scipy's brentq on thousands of cases."""

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq
from verification.shown import check

from abhv_mc.array_types import Floats
from abhv_mc.jit import kernel, scalar
from abhv_mc.numerics.root_finding import CONVERGED, brent
from abhv_mc.verification.rows import Row

CASES = 5000
X_TOLERANCE = 1e-10


@scalar
def curve(x: Any, a: Any, b: Any, c: Any) -> Any:
    """Monotone with a root near ``a``: from nearly straight to nearly a step."""
    return math.atan(b * b * 100.0 * (x - a)) + c * (x - a)


@kernel
def _solve(cases: Any, roots: Any) -> None:
    for i in range(cases.shape[0]):
        a, b, c, low, high = cases[i, 0], cases[i, 1], cases[i, 2], cases[i, 3], cases[i, 4]
        root, _, status = brent(curve, (a, b, c), low, high, X_TOLERANCE, 500)
        roots[i] = root if status == CONVERGED else math.nan


def draw_cases() -> Floats:
    """``[case, 5]``: the curve's three numbers and the ends of the bracket."""
    low, high = (-2.0, -2.0, 0.0, -9.0, 3.0), (2.0, 2.0, 1.0, -3.0, 9.0)
    return np.random.default_rng(1973).uniform(low, high, (CASES, 5))


def test_roots() -> None:
    cases = draw_cases()
    plain = getattr(curve, "py_func", curve)
    ends = np.array([[plain(row[3], *row[:3]), plain(row[4], *row[:3])] for row in cases])
    assert (ends[:, 0] * ends[:, 1] < 0.0).all()  # each bracket holds a root
    roots = np.empty(len(cases))
    _solve(cases, roots)
    expected = [brentq(plain, low, high, args=(a, b, c), xtol=1e-14) for a, b, c, low, high in cases.tolist()]
    check([Row("root finder", "scipy brentq", f"{CASES} roots", "-", float(np.abs(roots - expected).max()), 2e-10)])
