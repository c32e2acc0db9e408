"""Derivatives of plant and controller at points of flights by fourth-order differences.

Tables are linear between their nodes, so derivatives jump at nodes. Near a node, a one-sided
difference on the side of the point is used; exactly at a node, the side of larger values is used,
as in the table look-up.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints, Mask
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.kernel.plant.vehicle import VARIABLES, Tables
from abhv_mc_vehicle.kernel.stability.probes import PlantAnswer
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.stability.plant_inputs import as_axes
from abhv_mc_vehicle.stability.probe import ask_plant, law_tick

_STEPS = np.array([0.5, 0.02, *[2e-5] * 8])  # difference steps of the path coordinates
_MOVE = 2e-5  # difference step of actuator positions
# difference steps of additional measurements, in m/s, -, g, rad, m and m/s2
_MORE_STEPS = np.array(
    [0.02, 1e-5, 1e-4, *[2e-5] * 3, *[1e-7] * 2, 0.5, 0.5, 0.02, 0.5, *[1e-3] * 3]
)
_CHANGE = 2e-5  # change of a command that a difference step of the memory should cause, rad
_NO_CHANGE = 1e-14  # largest change of a command that counts as zero
_TURNING = (path.CHI, path.BANK)  # angles measured between -180 and 180 deg

# offsets in steps, the weights at these offsets and, if not zero, the weight of the point itself
_CENTRAL = (np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12.0)
_RIGHT = (np.array([1.0, 2.0, 3.0, 4.0]), np.array([48.0, -36.0, 16.0, -3.0]) / 12.0, -25.0 / 12.0)

_UNEVEN = 0.01  # largest relative difference of one-sided changes that counts as equal
_ROUNDED = 1e-10  # largest change of a value that may be a rounding error

# function of points [point, coordinate] and their indices that returns values and table cells
Function = Callable[[Floats, Ints], tuple[Floats, Ints]]


class Slopes(NamedTuple):
    """Values of a function at points, with their slopes."""

    value: Floats  # values [point, value]
    slope: Floats  # slopes [point, value, coordinate]
    uneven: Mask  # [point, value, coordinate] whether one-sided slopes differ by more than 1 %


def cells_of(tables: Tables, variables: Floats) -> Ints:
    """Return indices [point, axis] of the table cells that contain each point's variables."""
    cells = np.empty((len(variables), tables.axis_start.size), dtype=np.int64)
    for axis, (start, length) in enumerate(zip(tables.axis_start, tables.axis_length, strict=True)):
        grid = tables.grid[start : start + length]
        cells[:, axis] = np.searchsorted(
            grid, variables[:, tables.axis_variable[axis]], side="right"
        )
    return cells


def differentiate(function: Function, points: Floats, steps: Floats) -> Slopes:
    """Return the slopes at `points` [point, coordinate] with `steps` of the same shape."""
    count, width = points.shape
    value, cells = function(points, np.arange(count))
    expected = np.ones((count, width), dtype=bool)
    # Differences that would leave the table cell are one-sided instead of central.
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
    """Return the least-squares Newton step [point, unknown], or zero if it is not finite."""
    is_finite, step = (
        np.isfinite(J).all(axis=(1, 2)) & np.isfinite(left).all(axis=1),
        np.zeros((len(J), J.shape[2])),
    )
    step[is_finite] = np.einsum(
        "pij,pj->pi", np.linalg.pinv(J[is_finite], rcond=1e-13), left[is_finite]
    )
    return step


def _is_uneven(change: Floats) -> Mask:
    """Return whether the one-sided slopes differ.

    If the step is doubled, the second difference grows fourfold for a smooth curve and twofold for
    a kink.
    """
    _, left, right, _ = np.abs(np.moveaxis(change, 2, 0)).swapaxes(2, 3)
    near, far = (np.abs(change[:, :, i] + change[:, :, 3 - i]).swapaxes(1, 2) for i in (1, 0))
    return np.asarray(
        (near > _UNEVEN * np.maximum(left, right)) & (near > _ROUNDED) & (far < 3.0 * near)
    )


def _ask(
    function: Function, points: Floats, steps: Floats, expected: Mask, offsets: Floats
) -> tuple[Floats, Ints]:
    """Return values [point, coordinate, offset, value] and cells at offsets.

    `offsets` [point, coordinate, offset] are numbers of steps.
    """
    point, coordinate = np.nonzero(expected)
    number = offsets.shape[-1]
    moved = np.repeat(points[point], number, axis=0)
    rows = np.arange(len(moved))
    columns = np.repeat(coordinate, number)
    moved[rows, columns] += (offsets[point, coordinate] * steps[point, coordinate, None]).ravel()
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
    """Points of linearization, one row each, in SI units and radians."""

    path: Floats  # true path coordinates [point, 10]
    controls: (
        Floats  # positions [point, input] of the inputs in abhv_mc_vehicle.stability.plant_inputs
    )
    latitude: Floats  # latitude [point]
    mass: Floats  # mass [point]
    measured: Floats  # measurement used by the controller [point, 10]
    memory: Floats  # controller's memory before its tick [point, memory]
    # [point, row] the kernel's memory in the tick, with dispersions, wind and failures
    lane: Floats
    custom: Floats  # states of custom dynamics [point, state]
    tick: int  # index of the row in the reference and in the gains


def plant_slopes(plan: FlightPlan, points: Points, hold_slow: bool = False) -> Slopes:
    """Return path rates, sideslip, measurement and custom rates with their slopes.

    Values have the shape [point, 10 + 1 + measured + custom]; slopes are derivatives with respect
    to path coordinates, controls and custom states. The sideslip is relative to the air.
    """
    n = 10 + points.controls.shape[1]

    def rates(x: Floats, point: Ints) -> tuple[Floats, Ints]:
        answer, states = ask_at(
            plan, points, x[:, :10], x[:, 10:n], x[:, n:], point=point, hold_slow=hold_slow
        )
        measured = answer.measured
        for angle in _TURNING:  # Remove the jump of angles at 180 deg.
            measured[:, angle] = x[:, angle] + _wrapped(measured[:, angle] - x[:, angle])
        sideslip = answer.variables[:, [VARIABLES.index("sideslip")]]
        quantities = path.path_rates(states, answer.rates), sideslip, measured, answer.custom_rates
        values = np.hstack(quantities)
        return values, cells_of(plan.vehicle.tables, answer.variables)

    coordinates = np.hstack([points.path, points.controls, points.custom])
    steps = np.append(_STEPS, np.full(coordinates.shape[1] - 10, _MOVE))
    steps = np.tile(steps, (len(coordinates), 1))
    steps[:, n:] *= np.maximum(np.abs(points.custom), 1.0)
    return differentiate(rates, coordinates, steps)


def ask_at(
    plan: FlightPlan,
    points: Points,
    coordinates: Floats,
    controls: Floats,
    custom: Floats,
    *,
    point: Ints,
    hold_slow: bool = False,
) -> tuple[PlantAnswer, Floats]:
    """Evaluate each point's plant at path coordinates, input positions and custom states."""
    axes = as_axes(plan.vehicle, controls)
    states = path.make_states(coordinates, axes, points.latitude[point], points.mass[point])
    positions = controls if plan.vehicle.constants.driven else None
    answer = ask_plant(
        plan,
        points.lane,
        points.tick,
        point,
        states,
        custom,
        hold_slow=hold_slow,
        effectors_at=positions,
    )
    return answer, states


def _wrapped(angle: Floats) -> Floats:
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))


def law_slopes(plan: FlightPlan, points: Points) -> Slopes:
    """Return the controller's memory and commands after its tick, with their slopes.

    Slopes are derivatives with respect to the measurement and the memory.
    """
    n = points.measured.shape[1]

    def tick(x: Floats, point: Ints) -> tuple[Floats, Ints]:
        answer = law_tick(plan, points.tick, x[:, :n], x[:, n:])
        cells = [
            cells_of(plan.vehicle.tables, answer.variables),
            cells_of(plan.trim_tables, answer.guided),
        ]
        return np.hstack([answer.memory, answer.command]), np.hstack(cells)

    coordinates = np.hstack([points.measured, points.memory])
    steps = np.broadcast_to(measured_steps(n), points.measured.shape)
    return differentiate(tick, coordinates, np.hstack([steps, memory_steps(plan, points)]))


def measured_steps(count: int) -> Floats:
    """Return the difference steps of the first `count` measured quantities."""
    return np.append(_STEPS, _MORE_STEPS)[:count]


def memory_steps(plan: FlightPlan, points: Points) -> Floats:
    """Return difference steps [point, memory] that have about equal effects on the commands."""
    count = points.memory.shape[1]
    steps = 1e-6 * np.maximum(1.0, np.abs(points.memory))
    if count == 0:
        return steps
    base = law_tick(plan, points.tick, points.measured, points.memory)
    moved = points.memory[:, None, :] + steps[:, None, :] * np.eye(count)
    measured = np.repeat(points.measured, count, axis=0)
    answer = law_tick(plan, points.tick, measured, moved.reshape(-1, count))
    before, after = (np.hstack([tick.guidance, tick.command]) for tick in (base, answer))
    change = np.abs(after.reshape(len(before), count, -1) - before[:, None, :]).max(axis=-1)
    factor = np.clip(_CHANGE / np.maximum(change, _NO_CHANGE), 1e-3, 1e6)
    return np.asarray(np.where(change > _NO_CHANGE, steps * factor, steps))
