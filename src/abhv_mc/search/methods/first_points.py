"""First points of a search: centre, points along single dimensions, corners, Sobol points."""

from collections.abc import Callable

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import LANES, Record

_MOST_CORNERS = 512  # number of corners of the largest box whose corners are all evaluated
# share of the evaluations that a climb over corners may use, and their minimum number
_CLIMB_SHARE, _CLIMB_LEAST = 0.2, 256


def sobol_points(dimension: int, number: int, seed: int) -> Floats:
    """Return the first points of a scrambled Sobol sequence in the box -1 .. 1."""
    from scipy.stats.qmc import Sobol

    sequence = Sobol(dimension, rng=np.random.default_rng(seed))
    drawn = sequence.random_base2(max(0, int(number - 1).bit_length()))
    return 2.0 * drawn[:number] - 1.0


def explore(record: Record, dimension: int, seed: int, batch: int) -> None:
    """Evaluate the first points in whole batches, about a quarter of all evaluations."""
    share = record.limit // 4
    star = np.concatenate([np.zeros((1, dimension)), np.eye(dimension), -np.eye(dimension)])
    even = sobol_points(dimension, record.limit, seed)
    taken = 0

    def fill(points: Floats) -> Floats:
        """Return the points, padded with Sobol points to whole batches."""
        nonlocal taken
        missing = -len(points) % batch
        taken += missing
        return np.concatenate([points, even[taken - missing : taken]])

    values = record.call(fill(star), "one at a time")[: len(star)]
    if 2**dimension <= min(_MOST_CORNERS, max(share, LANES)):
        bits = np.arange(2**dimension)[:, None] >> np.arange(dimension) & 1
        corners = fill(np.where(bits, 1.0, -1.0))
        for start in range(0, len(corners), batch):
            record.call(corners[start : start + batch], "corners")
    else:
        _climb_corners(record, values, batch, fill)
    while record.used < share:
        record.call(fill(even[taken : (taken := taken + batch)]), "Sobol points")


def _climb_corners(
    record: Record, star: Floats, batch: int, fill: Callable[[Floats], Floats]
) -> None:
    """Climb over corners, first from the corner up the slopes, then from its opposite.

    Each step evaluates all neighbouring corners, then corners that combine improving sign changes.
    """
    dimension = len(star) // 2
    slopes = star[1 : dimension + 1] - star[dimension + 1 :]
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    # dimensions sorted by the magnitude of the slope; small slopes have the least certain signs
    order = np.argsort(np.abs(slopes), kind="stable")
    corner, best, tried = np.where(slopes >= 0.0, 1.0, -1.0), -np.inf, set[bytes]()
    opposite = [-corner]
    # Each step uses two batches: the neighbouring corners, then the combined sign changes.
    share = record.used + max(_CLIMB_LEAST, int(_CLIMB_SHARE * record.limit))

    def call(expected: list[Floats]) -> tuple[list[Floats], Floats]:
        """Evaluate at most one batch of untried corners; return these corners and their values."""
        nonlocal corner, best
        candidates = [c for c in expected if c.tobytes() not in tried][:batch]
        if not candidates:
            return [], np.empty(0)
        tried.update(c.tobytes() for c in candidates)
        values = record.call(fill(np.array(candidates)), "corners")[: len(candidates)]
        if values.max() > best:
            best, corner = float(values.max()), candidates[int(np.argmax(values))]
        return candidates, values

    while record.used < share and record.left >= 2 * batch:
        middle, before = corner, best
        candidates, values = call(_neighbours(middle, order))
        if not candidates or best <= before:
            if not opposite:
                return
            corner, best = opposite.pop(), -np.inf
            continue
        # improvement by each single sign change
        at_middle = before if np.isfinite(before) else values[0]
        alone = {
            int(np.flatnonzero(c != middle)[0]): float(v - at_middle)
            for c, v in zip(candidates, values, strict=True)
            if np.count_nonzero(c != middle) == 1 and v > at_middle
        }
        gained = sorted(alone, key=lambda i: -alone[i])
        together = []
        for count in range(len(gained), 1, -1):
            changed = middle.copy()
            changed[gained[:count]] *= -1.0
            together.append(changed)
        if len(together) > 1 and record.used < share:
            call([*together, *_neighbours(together[0], order)])


def _neighbours(corner: Floats, order: np.ndarray) -> list[Floats]:
    """Return a corner and its neighbours with one or two signs changed, in this `order`."""
    doubles = ([i, j] for k, i in enumerate(order) for j in order[:k])
    corners = [corner]
    for changed in (*([i] for i in order), *doubles):
        corners.append(corner.copy())
        corners[-1][changed] *= -1.0
    return corners
