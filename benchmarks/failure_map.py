"""Are planted causes found? Campaigns of formulas, mapped as `abhv-mc explain DIR --all` maps a campaign's failures.

    python -m benchmarks.failure_map [SEEDS]

Five causes, two of them pairs, make about 3 % of 2000 flights of 20 dispersions fail. A campaign is mapped without an
error when the map has the causes that made a flight fail, no other, and no flight in a group that did not cause it.
"""

import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from abhv_mc.analysis.causes import group_failures
from abhv_mc.analysis.shrink import shrink_together

COUNT, FLIGHTS, BUDGET = 20, 2000, 400
Fails = Callable[[NDArray[np.float64]], NDArray[np.bool_]]


def planted(seed: int) -> tuple[list[tuple[int, ...]], NDArray[np.float64], Fails]:
    """The causes, the dispersions ``[flight, input]``, and what tells which cause makes flights fail."""
    rng = np.random.default_rng(seed)
    inputs = rng.choice(COUNT, 7, replace=False).tolist()
    causes = [(inputs[0],), (inputs[1],), (inputs[2],), (inputs[3], inputs[4]), (inputs[5], inputs[6])]
    values = rng.uniform(-1.0, 1.0, (FLIGHTS, COUNT))
    signs = rng.choice([-1.0, 1.0], COUNT)
    limits = {1: 0.9876, 2: 1.0 - 2.0 * np.sqrt(0.006)}  # 0.62 % and 0.6 % of the flights

    def fails(rows: NDArray[np.float64]) -> NDArray[np.bool_]:
        """By cause, ``[flight, cause]``: one-sided, each member beyond its limit."""
        return np.stack([np.all(rows[:, list(c)] * signs[list(c)] > limits[len(c)], axis=1) for c in causes], axis=1)

    return [tuple(sorted(cause)) for cause in causes], values, fails


def is_mapped(seed: int) -> bool:
    """Whether the campaign of this seed is mapped without an error."""
    causes, values, fails = planted(seed)
    failed = np.flatnonzero(fails(values).any(axis=1))

    def test(owners: NDArray[np.intp], keep: NDArray[np.bool_]) -> NDArray[np.float64]:
        rows = np.where(keep, values[failed[owners]], 0.0)
        return np.where(fails(rows).any(axis=1), 1.0, -np.inf)

    found = shrink_together(COUNT, test, [np.arange(COUNT)] * failed.size, BUDGET)
    groups, rest = group_failures(found, values[failed] > 0.0)
    flown = fails(values[failed])
    held = {cause: set(np.flatnonzero(flown[:, c])) for c, cause in enumerate(causes) if flown[:, c].any()}
    told = {group.inputs: set(group.failures) for group in groups}
    return not rest and set(told) == set(held) and all(told[cause] <= held[cause] for cause in told)


if __name__ == "__main__":
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    print(f"{sum(map(is_mapped, range(seeds)))} of {seeds} campaigns mapped without an error")
