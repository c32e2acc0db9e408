"""Slopes of the plant and of the law about points of flights, by differences of order 4 of their compiled code.

Tables are linear between their nodes, so slopes jump there. A point close to a node is differentiated to the side on
which it lies; one exactly on a node to the right of it, as the look-up does.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints, Mask
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.kernel.plant.vehicle import VARIABLES, Tables
from abhv_mc.kernel.stability.probes import PlantAnswer
from abhv_mc.stability import path_coordinates as path
from abhv_mc.stability.plant_inputs import as_axes
from abhv_mc.stability.probe import ask_plant, law_tick

_STEPS = np.array([0.5, 0.02, *[2e-5] * 8])  # of the path coordinates
_MOVE = 2e-5  # of the actuators' positions
# Of what laws of the user's own may ask for besides: m/s, -, g, rad (attitude, position), m, m/s, m.
_MORE_STEPS = np.array([0.02, 1e-5, 1e-4, *[2e-5] * 3, *[1e-7] * 2, 0.5, 0.5, 0.02, 0.5])
_CHANGE = 2e-5  # rad: what a step in the law's memory is to change in a command
_NO_CHANGE = 1e-14  # of one that the memory changes at a later tick only
_TURNING = (path.CHI, path.BANK)  # measured between -180 and 180 deg

# Offsets in steps, their weights, and, where it has one, the weight of the point itself.
_CENTRAL = (np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12.0)
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
    uneven: Mask  # [point, value, coordinate] it is another to the left than to the right, by more than 1 %


def cells_of(tables: Tables, variables: Floats) -> Ints:
    """Cell [point, axis] that each axis of the tables is in, from variables [point, variable]."""
    cells = np.empty((len(variables), tables.axis_start.size), dtype=np.int64)
    for axis, (start, length) in enumerate(zip(tables.axis_start, tables.axis_length, strict=True)):
        grid = tables.grid[start : start + length]
        cells[:, axis] = np.searchsorted(
            grid, variables[:, tables.axis_variable[axis]], side="right"
        )
    return cells


def differentiate(function: Function, points: Floats, steps: Floats) -> Slopes:
    """Slopes at ``points`` [point, coordinate] with ``steps`` of the same shape."""
    count, width = points.shape
    value, cells = function(points, np.arange(count))
    expected = np.ones((count, width), dtype=bool)
    # Central where all points of the difference are in the cell, otherwise to the side that has more of it.
    answer, near = _ask(function, points, steps, expected, np.tile(_CENTRAL[0], (count, width, 1)))
    inside = (near == cells[:, None, None, :]).all(axis=-1)
    slope = np.einsum("pcov,o->pvc", answer, _CENTRAL[1]) / steps[:, None, :]
    crossed = ~inside.all(axis=-1)
    uneven = _is_uneven(answer - value[:, None, None, :]) & ~crossed[:, None, :]
    if crossed.any():
        side = np.where(inside[..., 2], 1.0, -1.0)
        answer, _ = _ask(function, points, steps, crossed, side[..., None] * _RIGHT[0])
        one_sided = np.einsum("pcov,o->pvc", answer, _RIGHT[1]) + _RIGHT[2] * value[..., None]
        one_sided *= (side / steps)[:, None, :]
        slope = np.where(crossed[:, None, :], one_sided, slope)
    return Slopes(value, slope, uneven)


def newton_step(J: Floats, left: Floats) -> Floats:
    """What points [point, unknown] are off by, the least of the steps that are nearest; zero where not finite."""
    known, step = (
        np.isfinite(J).all(axis=(1, 2)) & np.isfinite(left).all(axis=1),
        np.zeros((len(J), J.shape[2])),
    )
    step[known] = np.einsum("pij,pj->pi", np.linalg.pinv(J[known], rcond=1e-13), left[known])
    return step


def _is_uneven(change: Floats) -> Mask:
    """Whether slopes left and right differ: a curve's change grows fourfold in two steps, a kink's twofold."""
    _, left, right, _ = np.abs(np.moveaxis(change, 2, 0)).swapaxes(2, 3)
    near, far = (np.abs(change[:, :, i] + change[:, :, 3 - i]).swapaxes(1, 2) for i in (1, 0))
    return np.asarray(
        (near > _UNEVEN * np.maximum(left, right)) & (near > _ROUNDED) & (far < 3.0 * near)
    )


def _ask(
    function: Function, points: Floats, steps: Floats, expected: Mask, offsets: Floats
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
    all_values, all_cells = (
        np.zeros((*shape, values.shape[1])),
        np.zeros((*shape, cells.shape[1]), dtype=np.int64),
    )
    all_values[point, coordinate] = values.reshape(-1, number, values.shape[1])
    all_cells[point, coordinate] = cells.reshape(-1, number, cells.shape[1])
    return all_values, all_cells


class Points(NamedTuple):
    """Where the flights are linearized, one row each, SI and radians."""

    path: Floats  # [point, 10] path coordinates of the truth
    controls: Floats  # [point, input] positions, see abhv_mc.stability.plant_inputs
    latitude: Floats  # [point]
    mass: Floats  # [point]
    measured: Floats  # [point, 10] what the law sees
    memory: Floats  # [point, memory] of the law before its tick
    lane: Floats  # [point, row] the kernel's memory in the tick: dispersions, wind, what has failed
    custom: Floats  # [point, state] of custom dynamics
    tick: int  # row of the reference and of the gains


def plant_slopes(plan: FlightPlan, points: Points, held: bool = False) -> Slopes:
    """Rates of the path, sideslip to the air, measurement [point, 10 + 1 + 10], then rates of custom states.

    Slopes over path, controls and custom states.
    """
    n = 10 + points.controls.shape[1]

    def rates(x: Floats, point: Ints) -> tuple[Floats, Ints]:
        answer, states = ask_at(plan, points, x[:, :10], x[:, 10:n], x[:, n:], point, held)
        measured = answer.measured
        for angle in _TURNING:  # without the step at half a turn
            measured[:, angle] = x[:, angle] + _wrapped(measured[:, angle] - x[:, angle])
        sideslip = answer.variables[:, [VARIABLES.index("sideslip")]]
        found = path.path_rates(states, answer.rates), sideslip, measured, answer.custom_rates
        values = np.hstack(found)
        return values, cells_of(plan.vehicle.tables, answer.variables)

    at = np.hstack([points.path, points.controls, points.custom])
    steps = np.append(_STEPS, np.full(at.shape[1] - 10, _MOVE))
    steps = np.tile(steps, (len(at), 1))
    steps[:, n:] *= np.maximum(np.abs(points.custom), 1.0)
    return differentiate(rates, at, steps)


def ask_at(
    plan: FlightPlan,
    points: Points,
    coordinates: Floats,
    controls: Floats,
    custom: Floats,
    point: Ints,
    held: bool = False,
) -> tuple[PlantAnswer, Floats]:
    """The plants of ``point`` at path coordinates, positions and custom states, and their states."""
    shown = as_axes(plan.vehicle, controls)
    states = path.make_states(coordinates, shown, points.latitude[point], points.mass[point])
    at = controls if plan.vehicle.constants.driven else None
    return ask_plant(plan, points.lane, points.tick, point, states, custom, held, at), states


def _wrapped(angle: Floats) -> Floats:
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))


def law_slopes(plan: FlightPlan, points: Points) -> Slopes:
    """The law's memory after its tick and its commands, and their slopes over the measurement and the memory."""
    n = points.measured.shape[1]

    def tick(x: Floats, point: Ints) -> tuple[Floats, Ints]:
        answer = law_tick(plan, points.tick, x[:, :n], x[:, n:])
        cells = [
            cells_of(plan.vehicle.tables, answer.variables),
            cells_of(plan.trim_tables, answer.guided),
        ]
        return np.hstack([answer.memory, answer.command]), np.hstack(cells)

    at = np.hstack([points.measured, points.memory])
    steps = np.broadcast_to(measured_steps(n), points.measured.shape)
    return differentiate(tick, at, np.hstack([steps, memory_steps(plan, points)]))


def measured_steps(count: int) -> Floats:
    """Steps of the first ``count`` measured quantities."""
    return np.append(_STEPS, _MORE_STEPS)[:count]


def memory_steps(plan: FlightPlan, points: Points) -> Floats:
    """Steps [point, memory] of the law's memory with about the same effect on its commands, whatever its units."""
    count = points.memory.shape[1]
    steps = 1e-6 * np.maximum(1.0, np.abs(points.memory))
    if count == 0:
        return steps
    base = law_tick(plan, points.tick, points.measured, points.memory)
    moved = points.memory[:, None, :] + steps[:, None, :] * np.eye(count)
    measured = np.repeat(points.measured, count, axis=0)
    answer = law_tick(plan, points.tick, measured, moved.reshape(-1, count))
    before, after = (np.hstack([each.guidance, each.command]) for each in (base, answer))
    change = np.abs(after.reshape(len(before), count, -1) - before[:, None, :]).max(axis=-1)
    factor = np.clip(_CHANGE / np.maximum(change, _NO_CHANGE), 1e-3, 1e6)
    return np.asarray(np.where(change > _NO_CHANGE, steps * factor, steps))
