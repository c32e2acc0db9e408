"""Slopes of the plant and of the laws within the tables' cells, by differences of order 4.

Tables are linear between their nodes, so slopes jump there. A point close to a node is differentiated to the side on
which it lies; one exactly on a node to the right of it, as the look-up does.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Ints
from abhv_mc.kernel.plant.vehicle import Tables

# Offsets in steps, their weights, and the weight of the point itself.
_CENTRAL = (np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12.0, 0.0)
_RIGHT = (np.array([1.0, 2.0, 3.0, 4.0]), np.array([48.0, -36.0, 16.0, -3.0]) / 12.0, -25.0 / 12.0)

_UNEVEN = 0.01  # of a change, what it may differ by to the other side
_ROUNDED = 1e-10  # a change of a value that rounding may leave

# What is differentiated: values [point, value] and cells [point, axis] of points [point, coordinate] whose
# originals are numbered by the second argument [point].
Function = Callable[[Floats, Ints], tuple[Floats, Ints]]


class Slopes(NamedTuple):
    """Values at the points and slopes there."""

    value: Floats  # [point, value]
    slope: Floats  # [point, value, coordinate]
    uneven: NDArray[
        np.bool_
    ]  # [point, value, coordinate] it is another to the left than to the right, by more than 1 %


def cells_of(tables: Tables, variables: Floats) -> Ints:
    """Cell [point, axis] that each axis of the tables is in, from variables [point, variable]."""
    cells = np.empty((len(variables), tables.axis_start.size), dtype=np.int64)
    for axis, (start, length) in enumerate(zip(tables.axis_start, tables.axis_length, strict=True)):
        grid = tables.grid[start : start + length]
        cells[:, axis] = np.searchsorted(grid, variables[:, tables.axis_variable[axis]], side="right")
    return cells


def differentiate(function: Function, points: Floats, steps: Floats) -> Slopes:
    """Slopes at ``points`` [point, coordinate] with ``steps`` of the same shape."""
    count, width = points.shape
    value, cells = function(points, np.arange(count))
    slope = np.empty((count, value.shape[1], width))
    expected = np.ones((count, width), dtype=bool)
    # Central where all points of the difference are in the cell, otherwise to the side that has more of it.
    answer, near = _ask(function, points, steps, expected, np.tile(_CENTRAL[0], (count, width, 1)))
    inside = (near == cells[:, None, None, :]).all(axis=-1)
    slope[:] = np.einsum("pcov,o->pvc", answer, _CENTRAL[1]) / steps[:, None, :]
    crossed = ~inside.all(axis=-1)
    uneven = _is_uneven(answer - value[:, None, None, :]) & ~crossed[:, None, :]
    if crossed.any():
        side = np.where(inside[..., 2] & inside[..., 3] | inside[..., 2], 1.0, -1.0)
        answer, _ = _ask(function, points, steps, crossed, side[..., None] * _RIGHT[0])
        one_sided = np.einsum("pcov,o->pvc", answer, _RIGHT[1]) + _RIGHT[2] * value[..., None]
        one_sided *= (side / steps)[:, None, :]
        slope = np.where(crossed[:, None, :], one_sided, slope)
    return Slopes(value, slope, uneven)


def newton_step(J: Floats, left: Floats) -> Floats:
    """What points [point, unknown] are off by, the least of the steps that are nearest; zero where not finite."""
    known, step = np.isfinite(J).all(axis=(1, 2)) & np.isfinite(left).all(axis=1), np.zeros((len(J), J.shape[2]))
    step[known] = np.einsum("pij,pj->pi", np.linalg.pinv(J[known], rcond=1e-13), left[known])
    return step


def _is_uneven(change: Floats) -> NDArray[np.bool_]:
    """Whether slopes left and right differ, [point, value, coordinate], by changes [point, coordinate, offset, value].

    A curve's difference grows fourfold with twice the step, a kink's twofold, a jump's not at all.
    """
    _, left, right, _ = np.abs(np.moveaxis(change, 2, 0)).swapaxes(2, 3)
    near, far = (np.abs(change[:, :, i] + change[:, :, 3 - i]).swapaxes(1, 2) for i in (1, 0))
    return np.asarray((near > _UNEVEN * np.maximum(left, right)) & (near > _ROUNDED) & (far < 3.0 * near))


def _ask(
    function: Function, points: Floats, steps: Floats, expected: NDArray[np.bool_], offsets: Floats
) -> tuple[Floats, Ints]:
    """Values [point, coordinate, offset, value] and cells, at ``offsets`` [point, coordinate, offset] in steps."""
    point, coordinate = np.nonzero(expected)
    number = offsets.shape[-1]
    moved = np.repeat(points[point], number, axis=0)
    rows = np.arange(len(moved))
    each = np.repeat(coordinate, number)
    moved[rows, each] += (offsets[point, coordinate] * steps[point, coordinate, None]).ravel()
    values, cells = function(moved, np.repeat(point, number))
    shape = (*expected.shape, number)
    all_values, all_cells = np.zeros((*shape, values.shape[1])), np.zeros((*shape, cells.shape[1]), dtype=np.int64)
    all_values[point, coordinate] = values.reshape(-1, number, values.shape[1])
    all_cells[point, coordinate] = cells.reshape(-1, number, cells.shape[1])
    return all_values, all_cells
