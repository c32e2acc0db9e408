"""The compiled plant and laws asked at single points: rates of a state, and one tick of a law's own code.

Linearizing takes differences of these, so that what is linearized is what flies; they begin with the kernel's own
memory of a flight, so that it is the vehicle as it is at the tick. Many points are asked abreast.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.control.law_file import USER_LAWS
from abhv_mc.control.laws.tlc import D_ALPHA, D_R, I_ALTITUDE, I_RATE
from abhv_mc.control.laws.user import FAULT
from abhv_mc.flight.arguments import Kept, make_kernel_plan
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.kernel import Active, begin_tick, control, evaluate, find_active, instruments
from abhv_mc.flight.memory import Z_ROWS, has_width, make_memory
from abhv_mc.flight.native_check import check_states
from abhv_mc.flight.navigation import navigate
from abhv_mc.flight.plan import LANES, FlightPlan, Recording
from abhv_mc.flight.user_law import law_memory, measured_count, must_fly_elsewhere, open_law, open_vehicle
from abhv_mc.io.input_error import InputError
from abhv_mc.jit import kernel, lanes
from abhv_mc.plant import state as s
from abhv_mc.plant.actuators import pass_commands
from abhv_mc.plant.air_profile import nominal_density
from abhv_mc.plant.disturbance import density_profile
from abhv_mc.plant.equations import Stage
from abhv_mc.plant.failures import Failures, fail_plant, fail_sensors
from abhv_mc.plant.parameters import NEVER
from abhv_mc.plant.state import SUM, XS, X
from abhv_mc.user_code.child import in_child
from abhv_mc.user_code.effector_commands import commands_effectors
from abhv_mc.vehicle.arrays import VARIABLES
from abhv_mc.vehicle.model import drive_axes

# What a law of the program remembers from tick to tick, as rows of the lane memory; the last commands are among it
# where it uses them.
_MEMORY: dict[str, dict[str, int]] = {
    "tlc": {
        **dict(
            zip(
                (
                    *(f"integral_of_{name}" for name in ("altitude", "flight_path_angle", "heading", "speed")),
                    *(f"integral_of_{name}" for name in ("angle_of_attack", "sideslip", "bank")),
                    *(f"integral_of_{name}" for name in ("roll_rate", "pitch_rate", "yaw_rate")),
                    *(f"differentiator_of_{name}" for name in ("angle_of_attack", "bank")),
                    *(f"differentiator_of_{name}" for name in ("roll_rate", "pitch_rate", "yaw_rate")),
                ),
                (*range(I_ALTITUDE, I_RATE + 3), *range(D_ALPHA, D_R + 1)),
                strict=True,
            )
        ),
        "last_aileron": s.CMD_AILERON,
        "last_rudder": s.CMD_RUDDER,
        "last_elevator": s.CMD_ELEVATOR,
    },
    "lqr": {},
}
_LONGEST = 600.0  # s that ticks of a law in native code may take
_WIDE = 1e6  # beyond any command: a law linearized without its limits
_N_SEEN = len(VARIABLES) + 7  # variables of the tables, then the guidance's commands, then those to the actuators


class LawTick(NamedTuple):
    """What a law makes of a measurement."""

    memory: Floats  # [point, memory] after the tick
    command: Floats  # [point, 4] aileron, rudder, elevator, equivalence ratio; nan where a user law fails
    variables: Floats  # [point, variable] at which it looked its tables up
    guidance: Floats  # [point, 3] commanded flight path angle, angle of attack, bank


class PlantAnswer(NamedTuple):
    """What the plant makes of states, and the sensors."""

    rates: Floats  # [point, 14] of the states before the actuators'
    variables: Floats  # [point, variable] of the tables
    measured: Floats  # [point, measured] without bias, noise and delay; a frozen measurement as it is


@lanes
def _load(Z, row, width, values, numbers, start, n):
    """Columns of ``values[numbers[start + lane]]`` into the rows from ``row``; spare lanes repeat the last."""
    for lane in range(width):
        source = numbers[start + min(lane, n - 1)]
        for i in range(values.shape[1]):
            Z[row + i, lane] = values[source, i]


@kernel
def probe_begin(plan, memory, before, numbers, tick, sensed, acting):
    """The tick's beginning, from the lane memory ``before`` [point, row] it.

    ``sensed`` [point, row] is the memory with the tick's measurement, ``acting`` with what has failed in the plant.
    """
    if has_width(memory, LANES):
        Z, width = memory.Z, memory.Z.shape[1]
        tick_length = plan.timing.step * plan.timing.steps_per_tick
        for start in range(0, before.shape[0], width):
            n = min(width, before.shape[0] - start)
            _load(Z, 0, width, before, numbers, start, n)
            active = find_active(Z, width, plan)
            begin_tick(plan, memory, width, active, tick)
            for lane in range(n):
                for i in range(before.shape[1]):
                    sensed[start + lane, i] = Z[i, lane]
            pass_commands(Z, width)
            fail_plant(Z, memory.A, width, active.failures, plan.vehicle, tick * tick_length, tick_length)
            for lane in range(n):
                for i in range(before.shape[1]):
                    acting[start + lane, i] = Z[i, lane]


@kernel
def probe_plant(plan, memory, held, acting, flight, states, numbers, tick, answer):
    """Fill ``answer`` for ``states`` [point, state] of flights with the lane memory ``acting`` [flight, row].

    ``flight`` [point] says whose; ``numbers`` [point] counts the points. Slow effectors stay where they are or, with
    ``held``, are where the state's mix puts them at the beginning of a tick.
    """
    if has_width(memory, LANES):
        Z, width = memory.Z, memory.Z.shape[1]
        rates, variables, measured = answer.rates, answer.variables, answer.measured
        tick_length = plan.timing.step * plan.timing.steps_per_tick
        for start in range(0, states.shape[0], width):
            n = min(width, states.shape[0] - start)
            _load(Z, 0, width, acting, flight, start, n)
            _load(Z, X, width, states, numbers, start, n)
            _load(Z, XS, width, states, numbers, start, n)
            active = find_active(Z, width, plan)
            for lane in range(width):
                for i in range(s.AILERON):
                    Z[SUM + i, lane] = 0.0
            density_profile(Z, width)
            nominal_density(Z, width, plan.profile)
            if held:
                for e in range(plan.vehicle.effectors.shape[0]):
                    for lane in range(width):
                        Z[s.SLOW_EFFECTOR + e, lane] = NEVER
                pass_commands(Z, width)
                fail_plant(Z, memory.A, width, active.failures, plan.vehicle, tick * tick_length, tick_length)
            found = active.failures
            failures = Failures(found.surfaces, True, found.engine, found.engines, found.sensors)
            moving = Active(active.disturbances, active.sensor_errors, failures, True)
            evaluate(plan, memory, width, Stage(1.0, 0.0), moving)
            navigate(Z, width, tick_length, tick == 0)
            instruments(plan, Z, width, active, 1)
            if active.failures.sensors:
                fail_sensors(Z, width, tick * tick_length)
            for lane in range(n):
                for i in range(rates.shape[1]):
                    rates[start + lane, i] = Z[SUM + i, lane]
                for i in range(variables.shape[1]):
                    variables[start + lane, i] = Z[s.VAR + i, lane]
                for i in range(measured.shape[1]):
                    measured[start + lane, i] = Z[s.MEASURED + i, lane]


@kernel
def probe_law(plan, memory, tick, rows, numbers, before, after, seen):
    """A tick of the plan's law from the memory rows ``before`` [point, row] to ``after``; the measurement is there."""
    if has_width(memory, LANES):
        Z, width = memory.Z, memory.Z.shape[1]
        for start in range(0, before.shape[0], width):
            n = min(width, before.shape[0] - start)
            for lane in range(width):
                source = numbers[start + min(lane, n - 1)]
                for i in range(rows.size):
                    Z[rows[i], lane] = before[source, i]
                Z[s.P, lane] = 1.0  # the factor of the nominal vehicle's terms
            control(plan, memory, width, plan.law, plan.user_code, tick)
            for lane in range(n):
                for i in range(rows.size):
                    after[start + lane, i] = Z[rows[i], lane]
                for i in range(s.N_VARIABLES):
                    seen[start + lane, i] = Z[s.VAR + i, lane]
                for i in range(3):
                    seen[start + lane, s.N_VARIABLES + i] = Z[s.COMMANDS + i, lane]
                for i in range(4):
                    seen[start + lane, s.N_VARIABLES + 3 + i] = Z[s.CMD + i, lane]


def check_linear(plan: FlightPlan) -> None:
    """Raise InputError for what has no linear model at the four inputs."""
    drive_axes(plan.vehicle)
    if plan.source is not None and plan.law == "python" and commands_effectors(plan.source):
        expected = "a law that commands aileron, rudder and elevator alone, for margins and linear models"
        raise InputError(plan.source.file, "a law that commands effectors", expected)


def begin(plan: FlightPlan, kept: Kept) -> tuple[Floats, Floats]:
    """Lane memories [flight, row] of kept flights with the measurement of their tick, and with what then has failed."""
    before = np.ascontiguousarray(kept.rows[:, :Z_ROWS])
    sensed, acting = np.empty_like(before), np.empty_like(before)
    flown = replace(plan, vehicle=drive_axes(plan.vehicle))
    kernel_plan = make_kernel_plan(flown, nominal_parameters(), Recording(0))
    with open_vehicle(flown, LANES) as vehicle:
        arguments = kernel_plan._replace(user_code=vehicle), make_memory(LANES)
        probe_begin(*arguments, before, np.arange(len(before)), kept.tick, sensed, acting)
    return sensed, acting


def ask_plant(
    plan: FlightPlan, lane: Floats, tick: int, flight: Ints, states: Floats, held: bool = False
) -> PlantAnswer:
    """The plants of flights with the memory ``lane`` [flight, row] at ``states`` [point, state] of ``flight`` [point].

    ``held``: effectors that failures made slow, and that are held over a tick, are where the state's mix puts them.
    """
    points = len(states)
    count = measured_count(plan)
    sizes = s.AILERON, len(VARIABLES), count
    answer = PlantAnswer(*(np.empty((points, size)) for size in sizes))
    flown = replace(plan, vehicle=drive_axes(plan.vehicle))
    kernel_plan = make_kernel_plan(flown, nominal_parameters(), Recording(0))
    rows = np.ascontiguousarray(lane[:, : s.LAW])
    numbers = np.asarray(flight, dtype=np.int64), np.ascontiguousarray(states), np.arange(points)
    with open_vehicle(flown, LANES) as vehicle:
        user_code = vehicle._replace(more=int(count > s.N_MEASURED))
        arguments = kernel_plan._replace(user_code=user_code), make_memory(LANES), held
        probe_plant(*arguments, rows, *numbers, tick, answer)
    return answer


def law_memory_rows(plan: FlightPlan) -> dict[str, int]:
    """Rows of the lane memory that the plan's law remembers, by name; the last commands are among them where
    it uses them.

    Raises InputError for a law of the user's own whose memory is not known.
    """
    if plan.law == "fmu":
        check_states(plan)
    if plan.law in USER_LAWS:
        return {name: row for name, (row, _) in law_memory(plan).items()}
    return _MEMORY[plan.law]


def law_tick(plan: FlightPlan, tick: int, measured: Floats, memory: Floats) -> LawTick:
    """One tick of the plan's law, its limits off, past the first tick.

    ``measured`` [point, measured] in the order of the measured rows, ``memory`` [point, memory] in that of
    law_memory_rows.
    A law of the user's own keeps the limits that are in its code.
    """
    count = measured.shape[1]
    rows = np.array([*range(s.MEASURED, s.MEASURED + count), *law_memory_rows(plan).values(), FAULT], np.int64)
    free, later = _without_limits(plan, tick), max(tick, 1)
    before = np.hstack([measured, memory, np.zeros((len(measured), 1))])
    after, seen = _run_law(free, later, rows, before)
    variables, guidance, command = np.split(seen, [len(VARIABLES), len(VARIABLES) + 3], axis=1)
    command[after[:, -1] > 0.0] = np.nan
    return LawTick(after[:, count:-1], command, variables, guidance)


def law_at(plan: FlightPlan, sensed: Floats, tick: int) -> Floats:
    """The law's memory [flight, memory] before its tick, from lane memories of :func:`begin`.

    That of tick 0 is of a flight that has always been at its start: its differentiators are at rest.
    """
    kept = law_memory_rows(plan)
    memory = sensed[:, list(kept.values())]
    if tick > 0:
        return memory
    if plan.law in USER_LAWS:
        memory[:] = [start for _, start in law_memory(plan).values()]
    rows = np.arange(Z_ROWS)
    resting = [name.startswith("differentiator") for name in kept]
    if any(resting):
        memory[:, resting] = _run_law(plan, 0, rows, sensed)[0][:, list(kept.values())][:, resting]
    return memory


def _run_law(plan: FlightPlan, tick: int, rows: Ints, before: Floats) -> tuple[Floats, Floats]:
    if must_fly_elsewhere(plan):
        return in_child(_run_law, plan, tick, rows, before, limit=_LONGEST)
    after, seen = np.empty_like(before), np.empty((len(before), _N_SEEN))
    with open_law(plan, LANES, memory_in_rows=True) as user_code:
        arguments = (
            make_kernel_plan(plan, nominal_parameters(), Recording(0))._replace(user_code=user_code),
            make_memory(LANES),
            tick,
        )
        probe_law(*arguments, rows, np.arange(len(before)), np.ascontiguousarray(before), after, seen)
    return after, seen


def _without_limits(plan: FlightPlan, tick: int) -> FlightPlan:
    """The plan as a law sees it that nothing limits; the row of ``tick`` 0 stands for tick 1, too."""
    constants = plan.vehicle.constants._replace(
        surface_limit=_WIDE, equivalence_ratio_min=-_WIDE, equivalence_ratio_max=_WIDE
    )
    settings = plan.settings.copy()
    if plan.law not in USER_LAWS:
        settings[-3:] = -_WIDE, _WIDE, _WIDE  # lowest and highest angle of attack, bank: last in both laws' settings
    free = replace(plan, vehicle=plan.vehicle._replace(constants=constants), settings=settings)
    if tick > 0:
        return free
    reference, gains = (np.repeat(each[:1], 2, axis=0) for each in (plan.reference, plan.gains))
    return replace(free, timing=plan.timing._replace(ticks=1), reference=reference, gains=gains)
