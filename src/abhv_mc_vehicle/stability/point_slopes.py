"""Derivatives of plant and controller at points of flights by fourth-order differences.

Tables are linear between their nodes, so derivatives jump at nodes. Near a node, a one-sided
difference on the side of the point is used; exactly at a node, the side of larger values is used,
as in the table look-up.

The derivatives of multi-rate controllers are taken over their period. Counters, clocks and modes in
the memory are not affected by small changes of the measurement. Derivatives with respect to
counters, clocks and modes are not computed, because half a tick of a counter has no meaning. During
a period, the measurement, the reference and the gains are constant; time and the controller's
memory advance.
"""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints, Mask
from abhv_mc.io.messages import InputError, counted
from abhv_mc_vehicle.control.law_file import USER_LAWS
from abhv_mc_vehicle.flight.fly import fly_until, nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.user_law import measured_count
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import VARIABLES, Tables
from abhv_mc_vehicle.kernel.stability.probes import PlantAnswer
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.stability.probe import (
    as_axes,
    ask_plant,
    begin,
    law_at,
    law_memory_rows,
    law_tick,
    run_law,
)

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
    cells = np.empty((len(variables), tables.axis_start.size), np.int64)
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
    expected = np.ones((count, width), bool)
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
    is_finite = np.isfinite(J).all(axis=(1, 2)) & np.isfinite(left).all(axis=1)
    step = np.zeros((len(J), J.shape[2]))
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
    return (near > _UNEVEN * np.maximum(left, right)) & (near > _ROUNDED) & (far < 3.0 * near)


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
    all_values = np.zeros((*shape, values.shape[1]))
    all_cells = np.zeros((*shape, cells.shape[1]), np.int64)
    all_values[point, coordinate] = values.reshape(-1, number, values.shape[1])
    all_cells[point, coordinate] = cells.reshape(-1, number, cells.shape[1])
    return all_values, all_cells


class Points(NamedTuple):
    """Points of linearization, one row each, in SI units and radians."""

    path: Floats  # true path coordinates [point, 10]
    controls: Floats  # positions [point, input] of the inputs in abhv_mc_vehicle.stability.probe
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
            change = measured[:, angle] - x[:, angle]
            change -= 2.0 * np.pi * np.round(change / (2.0 * np.pi))
            measured[:, angle] = x[:, angle] + change
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
    return np.where(change > _NO_CHANGE, steps * factor, steps)


LONGEST = 100  # longest supported period, ticks
_SETTLING = 2.0  # time before the controller is observed, s
_WATCHED = 2 * LONGEST  # number of observed ticks
_SAME = 0.01  # allowed relative difference between responses one period apart
_NOTHING = 1e-9  # largest slope or change of a command that counts as zero
_STEP = 1e-6  # difference step of the memory

SWITCHES = "the controller switches at its equilibrium"


class Period(NamedTuple):
    """Ticks after which a controller repeats, and memory that measurements do not affect."""

    ticks: int
    carried: Mask  # [memory] whether small changes of the measurement have no effect
    # [memory] memory after the transient, in the tick before tick m N + 1 (N: period, m: integer)
    start: Floats
    # names and values of constant memory variables that measurements do not affect
    modes: tuple[str, ...]


_known: dict[str, Period] = {}


def find_period(plan: FlightPlan) -> Period:
    """Return the declared period of the controller or, by default, the smallest one detected.

    Raise InputError if the controller is not periodic or contradicts the declared period.
    """
    if plan.commanding_law not in USER_LAWS:
        count = len(law_memory_rows(plan))
        return Period(1, np.zeros(count, bool), np.zeros(count), ())
    facts = (
        plan.law,
        plan.source_hash,
        plan.vehicle.foreign.digest.tobytes(),
        plan.timing,
        plan.period,
    )
    arrays = (plan.settings, plan.reference[0], plan.gains[0])
    key = hashlib.sha256(repr(facts).encode() + b"".join(a.tobytes() for a in arrays)).hexdigest()
    if key not in _known:
        _known[key] = _find_period(plan)
    return _known[key]


def _find_period(plan: FlightPlan) -> Period:
    names = list(law_memory_rows(plan))
    n = measured_count(plan)
    sensed, _ = begin(plan, fly_until(plan, nominal_parameters(), 0))
    start = np.hstack([sensed[0, s.MEASURED : s.MEASURED + n], law_at(plan, sensed, 0)[0]])
    settling = max(round(_SETTLING / plan.timing.tick), 1)
    # Copies of the controller: one undisturbed, one permanently disturbed, and one for each
    # disturbed quantity.
    steps = np.append(measured_steps(n), np.full(len(names), _STEP))
    change = np.vstack([np.zeros((2, steps.size)), np.diag(steps)])
    follow = np.maximum(np.arange(len(change)) == 1, 0).astype(np.int64)
    begun = start + change
    begun[1, :n] += steps[:n]
    ticks = settling + _WATCHED
    values = run_law(go_on(plan, 0, ticks), begun, ticks, follow, change)
    # Controllers without derivatives are rejected later, when derivatives are needed.
    values = np.nan_to_num(values)
    memory = values[:, :, : len(names)]
    carried = (memory[:, 1] == memory[:, 0]).all(axis=0)
    moved = np.append(np.ones(n, bool), ~carried)
    late = values[settling:]
    responses = (late[:, 2:] - late[:, :1]) / steps[:, None]
    responses = responses[:, moved][
        :, :, np.append(~carried, np.ones(values.shape[2] - len(names), bool))
    ]
    before = memory[settling - 1 : -1, 0]
    command = late[:, 0, len(names) :]
    clocks = before[:, carried]
    advance = np.diff(clocks, axis=0)
    only_grow = (advance >= 0.0).all(axis=0) | (advance <= 0.0).all(axis=0)
    clocks = np.where(only_grow, advance, clocks[:-1])
    repeat = next(
        (N for N in range(1, LONGEST + 1) if _repeats(N, responses, clocks, command)), None
    )
    file = str(plan.source and plan.source.file)
    if repeat is None:
        raise InputError(
            file,
            f"the controller does not repeat within {LONGEST} ticks",
            "a periodic controller, which margins require",
        )
    if plan.period % repeat:
        raise InputError(
            file,
            f"the controller repeats after {counted(repeat, 'tick')}, not {plan.period}",
            f"'period: {repeat}', or a multiple of it, in the controller file",
        )
    period = plan.period or repeat
    stay = carried & (before == before[0]).all(axis=0)
    modes = tuple(
        f"{name} {value:g}"
        for name, value in zip(names, before[0], strict=True)
        if stay[names.index(name)]
    )
    return Period(period, carried, before[(1 - settling) % period], modes)


def _repeats(N: int, responses: Floats, clocks: Floats, command: Floats) -> bool:
    """Return whether the controller's behaviour [tick, ...] repeats after `N` ticks.

    Commands that drift at a constant rate also count as repeating.
    """
    size = np.abs(responses).max(axis=0)
    difference = np.abs(responses[N:] - responses[:-N]).max(axis=0)
    drift = np.ptp(command[N:] - command[:-N], axis=0)
    same = np.abs(clocks[N:] - clocks[:-N]) <= _NOTHING * np.maximum(1.0, np.abs(clocks[N:]))
    steady = drift <= _SAME * np.ptp(command, axis=0) + _NOTHING
    return bool(
        ((difference <= _SAME * size) | (size < _NOTHING)).all() and same.all() and steady.all()
    )


def go_on(plan: FlightPlan, tick: int, ticks: int) -> FlightPlan:
    """Return the plan extended by `ticks`, with constant reference and gains after `tick`."""
    rows = np.minimum(np.arange(tick + ticks + 2), min(tick, len(plan.reference) - 1))
    reference = plan.reference[rows]
    reference[tick:, ref.TIME] = plan.timing.tick * np.arange(tick, len(rows))
    timing = plan.timing._replace(ticks=len(rows) - 1)
    return replace(
        plan, timing=timing, reference=reference, gains=np.ascontiguousarray(plan.gains[rows])
    )


def law_phases(plan: FlightPlan, points: Points) -> list[Slopes]:
    """Return the controller's slopes in each tick of its period, starting at the points' tick."""
    period = find_period(plan)
    if period.ticks == 1 and not period.carried.any():
        return [law_slopes(plan, points)]
    still = go_on(plan, points.tick, period.ticks)
    first = max(points.tick, 1)
    carried = np.flatnonzero(period.carried)
    n = points.measured.shape[1]
    phases = []
    for tick in range(first, first + period.ticks):
        law = law_slopes(still, points._replace(tick=tick))
        for slopes in (law.slope, law.uneven):
            slopes[:, carried] = 0
            slopes[:, :, n + carried] = 0
        points = points._replace(memory=law.value[:, : points.memory.shape[1]])
        phases.append(law)
    return phases


def over_period(plan: FlightPlan, points: Points) -> Slopes:
    """Return the memory after a period and the mean command, with their slopes."""
    phases = law_phases(plan, points)
    if len(phases) == 1:
        return phases[0]
    after = phases[0]
    m = points.memory.shape[1]
    n = points.measured.shape[1]
    memory = after.slope[:, :m]
    command = after.slope[:, m:]
    value = after.value[:, m:]
    for law in phases[1:]:
        slope = law.slope[:, :, n:] @ memory
        slope[:, :, :n] += law.slope[:, :, :n]
        memory = slope[:, :m]
        command = command + slope[:, m:]
        value = value + law.value[:, m:]
    count = len(phases)
    uneven = np.logical_or.reduce([law.uneven for law in phases])
    values = np.hstack([phases[-1].value[:, :m], value / count])
    return Slopes(values, np.concatenate([memory, command / count], axis=1), uneven)


def switching(plan: FlightPlan, law: Slopes) -> Mask:
    """Return a mask [point] of points at which a custom controller's one-sided slopes differ."""
    return np.asarray(law.uneven.any(axis=(1, 2)) & (plan.law in USER_LAWS))
