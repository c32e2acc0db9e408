"""Slopes of the plant and of the law about points of flights, by differences of their compiled code."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.kernel.plant.vehicle import VARIABLES
from abhv_mc.kernel.stability.probes import PlantAnswer
from abhv_mc.stability import path_coordinates as path
from abhv_mc.stability.differences import Slopes, cells_of, differentiate
from abhv_mc.stability.plant_inputs import as_axes
from abhv_mc.stability.probe import ask_plant, law_tick

_STEPS = np.array([0.5, 0.02, *[2e-5] * 8])  # of the path coordinates
_MOVE = 2e-5  # of the actuators' positions
# Of what laws of the user's own may ask for besides: m/s, -, g, rad (attitude, position), m, m/s, m.
_MORE_STEPS = np.array([0.02, 1e-5, 1e-4, *[2e-5] * 3, *[1e-7] * 2, 0.5, 0.5, 0.02, 0.5])
_CHANGE = 2e-5  # rad: what a step in the law's memory is to change in a command
_NO_CHANGE = 1e-14  # of one that the memory changes at a later tick only
_TURNING = (path.CHI, path.BANK)  # measured between -180 and 180 deg


class Points(NamedTuple):
    """Where the flights are linearized, one row each, SI and radians."""

    path: Floats  # [point, 10] path coordinates of the truth
    controls: Floats  # [point, input] positions, see abhv_mc.stability.plant_inputs
    latitude: Floats  # [point]
    mass: Floats  # [point]
    measured: Floats  # [point, 10] what the law sees
    memory: Floats  # [point, memory] of the law before its tick
    lane: Floats  # [point, row] the kernel's memory in the tick: dispersions, wind, what has failed
    tick: int  # row of the reference and of the gains


def plant_slopes(plan: FlightPlan, points: Points, held: bool = False) -> Slopes:
    """Rates of the path coordinates, sideslip to the air and measurement [point, 10 + 1 + 10], and their slopes.

    Slopes [point, 21, 10 + input] are over the path coordinates and the controls; ``held`` as in
    :func:`abhv_mc.stability.probe.ask_plant`.
    """

    def rates(x: Floats, point: Ints) -> tuple[Floats, Ints]:
        answer, states = ask_at(plan, points, x[:, :10], x[:, 10:], point, held)
        measured = answer.measured
        for angle in _TURNING:  # without the step at half a turn
            measured[:, angle] = x[:, angle] + _wrapped(measured[:, angle] - x[:, angle])
        sideslip = answer.variables[:, [VARIABLES.index("sideslip")]]
        values = np.hstack([path.path_rates(states, answer.rates), sideslip, measured])
        return values, cells_of(plan.vehicle.tables, answer.variables)

    at = np.hstack([points.path, points.controls])
    steps = np.append(_STEPS, np.full(points.controls.shape[1], _MOVE))
    return differentiate(rates, at, np.broadcast_to(steps, at.shape))


def ask_at(
    plan: FlightPlan, points: Points, coordinates: Floats, controls: Floats, point: Ints, held: bool = False
) -> tuple[PlantAnswer, Floats]:
    """The plants of ``point`` at path coordinates and positions, and their states."""
    shown = as_axes(plan.vehicle, controls)
    states = path.make_states(coordinates, shown, points.latitude[point], points.mass[point])
    at = controls if plan.vehicle.constants.driven else None
    return ask_plant(plan, points.lane, points.tick, point, states, held, at), states


def _wrapped(angle: Floats) -> Floats:
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))


def law_slopes(plan: FlightPlan, points: Points) -> Slopes:
    """The law's memory after its tick and its commands, and their slopes over the measurement and the memory."""
    n = points.measured.shape[1]

    def tick(x: Floats, point: Ints) -> tuple[Floats, Ints]:
        answer = law_tick(plan, points.tick, x[:, :n], x[:, n:])
        cells = [cells_of(plan.vehicle.tables, answer.variables), cells_of(plan.trim_tables, answer.guided)]
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
