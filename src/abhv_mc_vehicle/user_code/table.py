"""Linear look-ups on custom grids and scattered points."""

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from abhv_mc.io.messages import Refusal, one_of
from abhv_mc_vehicle.kernel.jit import scalar

_INSIDE = -1e-12  # smallest barycentric coordinate that counts as inside, to allow for rounding
ENDS = {"neither": (False, False), "min": (True, False), "max": (False, True), "both": (True, True)}


class LookUp:
    """Base class of look-ups, bit-identical in compiled code and plain Python."""

    @functools.cached_property
    def _look_up(self) -> Any:
        return self.make_compiled()

    def __call__(self, *coordinates: float) -> float:
        """Return the value at ``coordinates``."""
        look_up = getattr(self._look_up, "py_func", self._look_up)
        return float(look_up(*coordinates))

    def make_compiled(self) -> Any:
        """Return the look-up as a function for compiled code, with its numbers as constants."""
        raise NotImplementedError


class Table(LookUp):
    """Multilinear interpolation on grids: ``table(grid_0, grid_1, ..., values)``.

    Parameters
    ----------
    arrays
        Ascending grids, and values [grid, grid, ...].
    extrapolate
        Ends of the grids beyond which values are extrapolated linearly instead of held constant:
        ``neither``, ``min``, ``max`` or ``both``, as one string for all grids or one string per
        grid.

    Examples
    --------
    >>> lift = table([0.0, 10.0], [0.0, 5.0])
    >>> lift(4.0), lift(20.0)
    (2.0, 5.0)
    """

    def __init__(self, *arrays: ArrayLike, extrapolate: str | Sequence[str] = "neither") -> None:
        *grids, values = (np.ascontiguousarray(array, np.float64) for array in arrays)
        if not grids or values.shape != tuple(grid.size for grid in grids):
            raise Refusal(
                f"grids of the sizes {tuple(grid.size for grid in grids)} do not match values of "
                f"the shape {values.shape}",
                "values with one axis for each grid",
            )
        if not all(
            grid.ndim == 1 and grid.size > 1 and (np.diff(grid) > 0.0).all() for grid in grids
        ):
            raise Refusal("a grid does not increase", "at least two increasing numbers")
        if not all(np.isfinite(array).all() for array in (*grids, values)):
            raise Refusal("the table contains a value that is not finite", "finite numbers")
        ends = (extrapolate,) * len(grids) if isinstance(extrapolate, str) else tuple(extrapolate)
        if len(ends) != len(grids) or not all(end in ENDS for end in ends):
            raise Refusal(
                f"found extrapolate={extrapolate!r}",
                f"{one_of(ENDS)}, for all grids or for each grid",
            )
        self.grids = tuple(grids)
        self.values = values
        self.extrapolate = tuple(ENDS[end] for end in ends)

    def make_compiled(self) -> Any:
        if len(self.grids) == 1:
            return _make_1d(self.grids[0], self.values, *self.extrapolate[0])
        if len(self.grids) == 2:
            return _make_2d(*self.grids, self.values, *self.extrapolate[0], *self.extrapolate[1])
        return _make_nd(self)


def _make_1d(grid: Any, values: Any, below: bool, above: bool) -> Any:
    last = grid.size - 1

    def look_up(x):  # type: ignore[no-untyped-def]
        x = grid[0] if x < grid[0] and not below else x
        x = grid[last] if x > grid[last] and not above else x
        i = 0
        for k in range(1, last):
            i = k if x >= grid[k] else i
        t = (x - grid[i]) / (grid[i + 1] - grid[i])
        return (1.0 - t) * values[i] + t * values[i + 1]

    return scalar(look_up)


def _make_2d(
    grid_0: Any,
    grid_1: Any,
    values: Any,
    below_0: bool,
    above_0: bool,
    below_1: bool,
    above_1: bool,
) -> Any:
    last_0 = grid_0.size - 1
    last_1 = grid_1.size - 1

    def look_up(x, y):  # type: ignore[no-untyped-def]
        x = grid_0[0] if x < grid_0[0] and not below_0 else x
        x = grid_0[last_0] if x > grid_0[last_0] and not above_0 else x
        y = grid_1[0] if y < grid_1[0] and not below_1 else y
        y = grid_1[last_1] if y > grid_1[last_1] and not above_1 else y
        i = 0
        j = 0
        for k in range(1, last_0):
            i = k if x >= grid_0[k] else i
        for k in range(1, last_1):
            j = k if y >= grid_1[k] else j
        t = (x - grid_0[i]) / (grid_0[i + 1] - grid_0[i])
        u = (y - grid_1[j]) / (grid_1[j + 1] - grid_1[j])
        low = (1.0 - u) * values[i, j] + u * values[i, j + 1]
        high = (1.0 - u) * values[i + 1, j] + u * values[i + 1, j + 1]
        return (1.0 - t) * low + t * high

    return scalar(look_up)


def _make_nd(table: Table) -> Any:
    """Return a look-up on three or more grids as a weighted sum over the cell corners."""
    axes = len(table.grids)
    grid = np.concatenate(table.grids)
    lengths = np.array([own.size for own in table.grids])
    starts = np.cumsum(lengths) - lengths
    strides = np.array(table.values.strides) // table.values.itemsize
    below = np.array([ends[0] for ends in table.extrapolate])
    above = np.array([ends[1] for ends in table.extrapolate])
    values = table.values.ravel()

    def look_up(*at):  # type: ignore[no-untyped-def]
        value = 0.0
        for corner in range(1 << axes):
            weight = 1.0
            place = 0
            for axis in range(axes):
                start = starts[axis]
                last = starts[axis] + lengths[axis] - 1
                x = at[axis]
                x = grid[start] if x < grid[start] and not below[axis] else x
                x = grid[last] if x > grid[last] and not above[axis] else x
                i = start
                for k in range(start + 1, last):
                    i = k if x >= grid[k] else i
                t = (x - grid[i]) / (grid[i + 1] - grid[i])
                up = (corner >> axis) & 1
                weight *= t if up else 1.0 - t
                place += strides[axis] * (i - start + up)
            value += weight * values[place]
        return value

    return scalar(look_up)


class Scattered(LookUp):
    """Linear interpolation between scattered points: ``scattered(points, values)``.

    The look-up is linear in the simplices of the Delaunay triangulation. Outside the hull the
    nearest simplex is used, with negative barycentric coordinates set to zero.

    Parameters
    ----------
    points
        Coordinates [point, axis].
    values
        Values [point].

    Examples
    --------
    >>> lift = scattered([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [0.0, 1.0, 2.0])
    >>> lift(0.25, 0.25)
    0.75
    """

    def __init__(self, points: ArrayLike, values: ArrayLike) -> None:
        from scipy.spatial import Delaunay, QhullError

        positions, point_values = (
            np.ascontiguousarray(array, np.float64) for array in (points, values)
        )
        positions = positions[:, np.newaxis] if positions.ndim == 1 else positions
        if (
            positions.ndim != 2
            or point_values.shape != positions.shape[:1]
            or not (np.isfinite(positions).all() and np.isfinite(point_values).all())
        ):
            raise Refusal(
                f"the points have the shape {positions.shape} and the values {point_values.shape}",
                "finite arrays points[point, axis] and values[point]",
            )
        if positions.shape[1] == 1:
            order = np.argsort(positions[:, 0])
            corners = np.stack([order[:-1], order[1:]], axis=1)
        else:
            try:
                corners = Delaunay(positions).simplices
            except QhullError:
                raise Refusal(
                    "the points do not span a volume", "points that do not all lie in a plane"
                ) from None
        self.axes = positions.shape[1]
        self.values = point_values[corners]  # [simplex, corner]
        # Barycentric coordinates are ``transform`` times the vector from the last corner.
        last = positions[corners[:, -1]]
        edges = np.swapaxes(positions[corners[:, :-1]] - last[:, np.newaxis], 1, 2)
        self.transform = np.linalg.inv(edges)
        self.last = np.ascontiguousarray(last)

    def make_compiled(self) -> Any:
        axes = self.axes
        simplices = len(self.values)
        transform = self.transform
        last = self.last
        values = self.values

        def look_up(*at):  # type: ignore[no-untyped-def]
            best = 0
            worst = -np.inf
            for k in range(
                simplices
            ):  # The containing or nearest simplex has the largest minimum coordinate.
                least = np.inf
                rest = 1.0
                for i in range(axes):
                    part = 0.0
                    for j in range(axes):
                        part += transform[k, i, j] * (at[j] - last[k, j])
                    least = part if part < least else least
                    rest -= part
                least = rest if rest < least else least
                better = least > worst and worst < _INSIDE
                best = k if better else best
                worst = least if better else worst
            total = 0.0
            sum_of = 0.0
            rest = 1.0
            for i in range(axes):
                part = 0.0
                for j in range(axes):
                    part += transform[best, i, j] * (at[j] - last[best, j])
                rest -= part
                held = part if part > 0.0 else 0.0
                total += held * values[best, i]
                sum_of += held
            held = rest if rest > 0.0 else 0.0
            return (total + held * values[best, axes]) / (sum_of + held)

        return scalar(look_up)
