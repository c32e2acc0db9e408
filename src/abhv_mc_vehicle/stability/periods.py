"""Period of multi-rate controllers, and derivatives of the controllers over the period.

Counters, clocks and modes in the memory are not affected by small changes of the measurement.
Derivatives with respect to counters, clocks and modes are not computed, because half a tick of a
counter has no meaning. During a period, the measurement, the reference and the gains are constant;
time and the controller's memory advance.
"""

import hashlib
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.io.input_error import InputError
from abhv_mc.io.phrases import counted
from abhv_mc_vehicle.control.law_file import USER_LAWS
from abhv_mc_vehicle.flight.fly import fly_until, nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.user_law import measured_count
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.stability.point_slopes import Points, Slopes, law_slopes, measured_steps
from abhv_mc_vehicle.stability.probe import begin, law_at, law_memory_rows, run_law

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
    names, n = list(law_memory_rows(plan)), measured_count(plan)
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
    values = run_law(
        go_on(plan, 0, settling + _WATCHED), 0, begun, settling + _WATCHED, follow, change=change
    )
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
    before, command = memory[settling - 1 : -1, 0], late[:, 0, len(names) :]
    clocks = before[:, carried]
    only_grow = (np.diff(clocks, axis=0) >= 0.0).all(axis=0) | (np.diff(clocks, axis=0) <= 0.0).all(
        axis=0
    )
    clocks = np.where(
        only_grow, np.append(np.diff(clocks, axis=0), clocks[:1] * 0.0, axis=0), clocks
    )[:-1]
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
        problem = f"the controller repeats after {counted(repeat, 'tick')}, not {plan.period}"
        raise InputError(
            file, problem, f"'period: {repeat}', or a multiple of it, in the controller file"
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
    still, first = go_on(plan, points.tick, period.ticks), max(points.tick, 1)
    carried, n, phases = np.flatnonzero(period.carried), points.measured.shape[1], []
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
    after, m, n = phases[0], points.memory.shape[1], points.measured.shape[1]
    memory, command, value = after.slope[:, :m], after.slope[:, m:], after.value[:, m:]
    for law in phases[1:]:
        slope = law.slope[:, :, n:] @ memory
        slope[:, :, :n] += law.slope[:, :, :n]
        memory, command, value = slope[:, :m], command + slope[:, m:], value + law.value[:, m:]
    count = len(phases)
    uneven = np.logical_or.reduce([law.uneven for law in phases])
    values = np.hstack([phases[-1].value[:, :m], value / count])
    return Slopes(values, np.concatenate([memory, command / count], axis=1), uneven)


def switching(plan: FlightPlan, law: Slopes) -> Mask:
    """Return a mask [point] of points at which a custom controller's one-sided slopes differ."""
    return np.asarray(law.uneven.any(axis=(1, 2)) & (plan.law in USER_LAWS))
