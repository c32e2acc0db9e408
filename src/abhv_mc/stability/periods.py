"""Laws of several rates: after how many ticks a law does the same again, and its slopes over such a period.

Counters, clocks and modes among its memory, which no small change of the measurement moves, run on as they are and are
never perturbed: half a tick of a counter means nothing. While a period passes, measurement, reference and gains stand
still; time and the law's memory go on.
"""

import hashlib
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.control.law_file import USER_LAWS
from abhv_mc.flight.fly import fly_until, nominal_parameters
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.flight.user_law import measured_count
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.laws import columns as ref
from abhv_mc.kernel.plant import state as s
from abhv_mc.stability.point_slopes import Points, Slopes, law_slopes, measured_steps
from abhv_mc.stability.probe import begin, law_at, law_memory_rows, run_law

LONGEST = 100  # ticks of a period
_SETTLING = 2.0  # s
_WATCHED = 2 * LONGEST  # ticks
_SAME = 0.01  # of a response: how far it may be from the one a period later
_NOTHING = 1e-9  # a slope, or a change of a command, that counts for none
_STEP = 1e-6  # of the memory

SWITCHES = "the law switches at its rest"


class Period(NamedTuple):
    """After how many ticks a law does the same again, and what it carries along."""

    ticks: int
    carried: Mask  # [memory] what no small change of the measurement moves
    start: Floats  # [memory] when it has settled, before a tick that is one more than a multiple of the period
    modes: tuple[str, ...]  # of what is carried, those that stay: name and value


_known: dict[str, Period] = {}


def find_period(plan: FlightPlan) -> Period:
    """As the plan declares it, else the smallest found. Raises InputError for a law that does not repeat, or not so."""
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
    # The undisturbed law; one that is always disturbed; then each quantity disturbed at one tick alone.
    steps = np.append(measured_steps(n), np.full(len(names), _STEP))
    change = np.vstack([np.zeros((2, steps.size)), np.diag(steps)])
    follow = np.maximum(np.arange(len(change)) == 1, 0).astype(np.int64)
    begun = start + change
    begun[1, :n] += steps[:n]
    values = run_law(
        go_on(plan, 0, settling + _WATCHED), 0, begun, settling + _WATCHED, follow, change
    )
    values = np.nan_to_num(
        values
    )  # where the law has no slopes it is refused for that, when they are asked for
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
    found = next(
        (N for N in range(1, LONGEST + 1) if _repeats(N, responses, clocks, command)), None
    )
    file = str(plan.source and plan.source.file)
    if found is None:
        raise InputError(
            file, f"a law that does not repeat within {LONGEST} ticks", "one that does, for margins"
        )
    if plan.period % found:
        words = f"a law that repeats after {found} ticks, not {plan.period}"
        raise InputError(
            file, words, f"'period: {found}', or a multiple of it, in its controller file"
        )
    period = plan.period or found
    stay = carried & (before == before[0]).all(axis=0)
    modes = tuple(
        f"{name} {value:g}"
        for name, value in zip(names, before[0], strict=True)
        if stay[names.index(name)]
    )
    return Period(period, carried, before[(1 - settling) % period], modes)


def _repeats(N: int, responses: Floats, clocks: Floats, command: Floats) -> bool:
    """Whether what a law does [tick, ...] is the same ``N`` ticks later; a command may drift besides."""
    size = np.abs(responses).max(axis=0)
    apart = np.abs(responses[N:] - responses[:-N]).max(axis=0)
    drift = np.ptp(command[N:] - command[:-N], axis=0)
    same = np.abs(clocks[N:] - clocks[:-N]) <= _NOTHING * np.maximum(1.0, np.abs(clocks[N:]))
    steady = drift <= _SAME * np.ptp(command, axis=0) + _NOTHING
    return bool(((apart <= _SAME * size) | (size < _NOTHING)).all() and same.all() and steady.all())


def go_on(plan: FlightPlan, tick: int, ticks: int) -> FlightPlan:
    """The plan whose reference and gains stand still from ``tick`` on, while their time goes on, for some ticks."""
    rows = np.minimum(np.arange(tick + ticks + 2), min(tick, len(plan.reference) - 1))
    reference = plan.reference[rows]
    reference[tick:, ref.TIME] = plan.timing.tick * np.arange(tick, len(rows))
    timing = plan.timing._replace(ticks=len(rows) - 1)
    return replace(
        plan, timing=timing, reference=reference, gains=np.ascontiguousarray(plan.gains[rows])
    )


def law_phases(plan: FlightPlan, points: Points) -> list[Slopes]:
    """Slopes of the law in each tick of its period, from the points' tick and memory on."""
    period = find_period(plan)
    if period.ticks == 1 and not period.carried.any():
        return [law_slopes(plan, points)]
    still, first = go_on(plan, points.tick, period.ticks), max(points.tick, 1)
    carried, n, phases = np.flatnonzero(period.carried), points.measured.shape[1], []
    for tick in range(first, first + period.ticks):
        law = law_slopes(still, points._replace(tick=tick))
        for each in (law.slope, law.uneven):
            each[:, carried] = 0
            each[:, :, n + carried] = 0
        points = points._replace(memory=law.value[:, : points.memory.shape[1]])
        phases.append(law)
    return phases


def over_period(plan: FlightPlan, points: Points) -> Slopes:
    """The memory after a period and the mean command in it; slopes over measurement and memory before."""
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
    """Whether a user law has other slopes to the left of the point than to the right of it, [point]."""
    return np.asarray(law.uneven.any(axis=(1, 2)) & (plan.law in USER_LAWS))
