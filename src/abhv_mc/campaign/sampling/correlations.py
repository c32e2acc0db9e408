"""Correlations of normal variables that yield stated rank correlations of parameters.

The ranks of equal values are averaged. For continuous marginals, the normal correlation of a rank
correlation rho is 2 sin(pi rho / 6) (Kruskal, JASA 53, 1958). For discrete values it is the root of
the rank correlation over Sobol points (NORTA: Cario & Nelson 1997).
"""

import math
from collections.abc import Sequence

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.marginals import Marginal, find_atoms
from abhv_mc.io.documents import Refusal
from abhv_mc.io.phrases import quoted

_LARGEST = 1.0 - 1e-6  # largest normal correlation of discrete values
_POINTS = 14  # binary logarithm of the number of Sobol points
_STEP = 1e-3  # resolution of valid correlations, and smallest eigenvalue of their matrix
_PROJECTIONS = 500


def is_discrete(marginals: Sequence[Marginal]) -> bool:
    """Return whether any of the marginals has values with positive probability."""
    return any(find_atoms(marginal).size for marginal in marginals)


def normal_correlation(rank: float, marginals: Sequence[Marginal]) -> float:
    """Return the normal correlation that yields a rank correlation of two parameters.

    Raise Refusal if the discrete values do not permit the rank correlation.
    """
    if not rank or not is_discrete(marginals):
        return 2.0 * math.sin(math.pi / 6.0 * rank)
    from scipy.optimize import brentq
    from scipy.special import ndtr, ndtri
    from scipy.stats import qmc, spearmanr

    first, second = ndtri(qmc.Sobol(2, rng=np.random.default_rng(0)).random_base2(_POINTS).T)
    values = marginals[0].ppf(ndtr(first))

    def error(normal: float) -> float:
        mixed = normal * first + math.sqrt(1.0 - normal**2) * second
        return float(spearmanr(values, marginals[1].ppf(ndtr(mixed))).statistic) - rank

    ends = error(-_LARGEST), error(_LARGEST)
    if not ends[0] < 0.0 < ends[1]:
        low, high = (f"{end + rank - math.copysign(5e-4, end + rank):.3f}" for end in ends)
        problem = f"the discrete values do not permit the rank correlation {rank:g}"
        raise Refusal(problem, f"a rank correlation from {low} to {high}", ("rank",))
    return round(brentq(error, -_LARGEST, _LARGEST, xtol=1e-8), 6)


def nearest_valid(names: Sequence[str], matrix: Floats) -> str:
    """Return the nearest correlations for which `matrix` [name, name] is positive definite.

    The result names one pair if a change of its correlation suffices; otherwise it lists the
    nearest matrix with the same zeros (Frobenius norm; N. Higham, IMA Journal of Numerical Analysis
    22, 2002).
    """
    pairs, values = np.argwhere(np.triu(matrix, 1)).tolist(), np.arange(_STEP - 1.0, 1.0, _STEP)
    changes = []
    for i, j in pairs:
        changed = np.repeat(matrix[None], len(values), axis=0)
        changed[:, i, j] = changed[:, j, i] = values
        for value in values[np.linalg.eigvalsh(changed)[:, 0] > _STEP]:
            changes.append((abs(value - matrix[i, j]), i, j, value))
    entries = [min(changes)[1:]] if changes else []
    if not entries:
        nearest, correction = matrix, np.zeros_like(matrix)
        for _ in range(_PROJECTIONS):  # Dykstra's alternating projections
            eigenvalues, vectors = np.linalg.eigh(nearest - correction)
            positive = (vectors * np.maximum(eigenvalues, _STEP * len(names))) @ vectors.T
            correction += positive - nearest
            nearest = np.where(matrix * (1.0 - np.eye(len(names))), positive, matrix)
        entries = [(i, j, nearest[i, j]) for i, j in pairs]
    return "; ".join(
        f"normal: {value:.3f} between {quoted((names[i], names[j]))}" for i, j, value in entries
    )
