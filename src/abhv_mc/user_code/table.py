"""Look-ups on the user's own grids, multilinear, clamped at the edges; the same bits compiled and in plain Python."""

import functools
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from abhv_mc.io.input_error import Refusal
from abhv_mc.jit import scalar


class Table:
    """Values over one or two grids: ``table(grid, values)``, ``table(grid_0, grid_1, values)``."""

    def __init__(self, *arrays: ArrayLike) -> None:
        *grids, values = (np.ascontiguousarray(array, dtype=np.float64) for array in arrays)
        if not 1 <= len(grids) <= 2 or values.shape != tuple(grid.size for grid in grids):
            raise Refusal(f"{len(grids)} grids and values of the shape {values.shape}", "values[grid, grid]")
        if not all(grid.ndim == 1 and grid.size > 1 and (np.diff(grid) > 0.0).all() for grid in grids):
            raise Refusal("a grid that does not rise", "at least two numbers that rise")
        if not all(np.isfinite(array).all() for array in (*grids, values)):
            raise Refusal("a table with what is not a number", "finite numbers")
        self.grids, self.values = tuple(grids), values

    @functools.cached_property
    def _look_up(self) -> Any:
        return self.make_compiled()

    def __call__(self, *at: float) -> float:
        """The value there."""
        look_up = getattr(self._look_up, "py_func", self._look_up)
        return float(look_up(*at))

    def make_compiled(self) -> Any:
        """The look-up as a function that compiled laws call; numbers of the table are constants of it."""
        if len(self.grids) == 1:
            return _make_1d(self.grids[0], self.values)
        first, second = self.grids
        return _make_2d(first, second, self.values)


def _make_1d(grid: Any, values: Any) -> Any:
    last = grid.size - 1

    def look_up(x):  # type: ignore[no-untyped-def]
        x = grid[0] if x < grid[0] else x
        x = grid[last] if x > grid[last] else x
        i = 0
        for k in range(1, last):
            i = k if x >= grid[k] else i
        t = (x - grid[i]) / (grid[i + 1] - grid[i])
        return (1.0 - t) * values[i] + t * values[i + 1]

    return scalar(look_up)


def _make_2d(grid_0: Any, grid_1: Any, values: Any) -> Any:
    last_0, last_1 = grid_0.size - 1, grid_1.size - 1

    def look_up(x, y):  # type: ignore[no-untyped-def]
        x = grid_0[0] if x < grid_0[0] else x
        x = grid_0[last_0] if x > grid_0[last_0] else x
        y = grid_1[0] if y < grid_1[0] else y
        y = grid_1[last_1] if y > grid_1[last_1] else y
        i, j = 0, 0
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
