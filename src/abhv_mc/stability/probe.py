"""The compiled plant and laws asked at single points: rates of a state, and one tick of a law's own code.

Linearising takes differences of these, so that what is linearised is what flies. Many points are asked abreast.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from abhv_mc.control.laws.tlc import D_ALPHA, D_R, I_ALTITUDE, I_RATE
from abhv_mc.control.laws.user import FAULT
from abhv_mc.flight.arguments import make_kernel_plan
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.kernel import control, evaluate
from abhv_mc.flight.memory import Z_ROWS, has_width, make_memory
from abhv_mc.flight.navigation import navigate
from abhv_mc.flight.plan import LANES, FlightPlan, Recording
from abhv_mc.flight.sensors import active_sensor_errors, sense
from abhv_mc.flight.user_law import PYTHON, law_memory, open_law
from abhv_mc.jit import kernel, lanes
from abhv_mc.plant import state as s
from abhv_mc.plant.disturbance import density_profile
from abhv_mc.plant.equations import Stage
from abhv_mc.plant.failures import start_failures
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.plant.state import SUM, XS, X
from abhv_mc.vehicle.arrays import VARIABLES, Floats, Ints

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
_MASS = PARAMETER_INDEX["mass.total"]
_WIDE = 1e6  # beyond any command: a law linearised without its limits
_N_SEEN = len(VARIABLES) + 7  # variables of the tables, then the guidance's commands, then those to the actuators


class LawTick(NamedTuple):
    """What a law makes of a measurement."""

    memory: Floats  # [point, memory] after the tick
    command: Floats  # [point, 4] aileron, rudder, elevator, equivalence ratio; nan where a law of one's own fails
    variables: Floats  # [point, variable] at which it looked its tables up
    guidance: Floats  # [point, 3] commanded flight path angle, angle of attack, bank


@lanes
def _load(Z, row, width, values, numbers, start, n):
    """Columns of ``values[numbers[start + lane]]`` into the rows from ``row``; spare lanes repeat the last."""
    for lane in range(width):
        source = numbers[start + min(lane, n - 1)]
        for i in range(values.shape[1]):
            Z[row + i, lane] = values[source, i]


@kernel
def probe_plant(plan, memory, flight, states, numbers, rates, variables):
    """Rates [point, state before the actuators] and variables [point, variable] of ``states`` [point, state].

    ``flight`` [point] says whose of the plan's parameters; ``numbers`` [point] counts the points.
    """
    if has_width(memory, LANES):
        Z, width = memory.Z, memory.Z.shape[1]
        for start in range(0, states.shape[0], width):
            n = min(width, states.shape[0] - start)
            _load(Z, s.P, width, plan.parameters, flight, start, n)
            _load(Z, X, width, states, numbers, start, n)
            _load(Z, XS, width, states, numbers, start, n)
            for lane in range(width):
                Z[s.PER_MASS_FACTOR, lane] = 1.0 / Z[s.P + _MASS, lane]
                Z[s.GUST_U, lane] = 0.0
                Z[s.GUST_V, lane] = 0.0
                Z[s.GUST_W, lane] = 0.0
                for i in range(s.AILERON):
                    Z[SUM + i, lane] = 0.0
            density_profile(Z, width)
            start_failures(Z, width)
            evaluate(plan, memory, width, Stage(1.0, 0.0), True, False)
            for lane in range(n):
                for i in range(rates.shape[1]):
                    rates[start + lane, i] = Z[SUM + i, lane]
                for i in range(variables.shape[1]):
                    variables[start + lane, i] = Z[s.VAR + i, lane]


@kernel
def probe_law(plan, memory, first_tick, end, states, rows, numbers, before, after, seen):
    """Ticks of the plan's law from the memory rows ``before`` [point, row] to ``after``.

    With ``states`` [point, tick, state] the flight is followed from ``first_tick`` up to the measurement of tick
    ``end``; without, the law makes one tick of the measurement that is among the rows.
    """
    if has_width(memory, LANES):
        Z, width = memory.Z, memory.Z.shape[1]
        replaying = states.shape[1] > 0
        tick_length = plan.timing.step * plan.timing.steps_per_tick
        for start in range(0, before.shape[0], width):
            n = min(width, before.shape[0] - start)
            for lane in range(width):
                source = numbers[start + min(lane, n - 1)]
                for i in range(rows.size):
                    Z[rows[i], lane] = before[source, i]
                Z[s.P, lane] = 1.0  # the factor of the nominal vehicle's terms
            sensor_errors = active_sensor_errors(Z, width)
            for tick in range(first_tick, end + 1):
                if replaying:
                    for lane in range(width):
                        source = numbers[start + min(lane, n - 1)]
                        for i in range(s.N_STATES):
                            Z[X + i, lane] = states[source, tick, i]
                    navigate(Z, width, tick_length, tick == 0)
                    sense(Z, width, sensor_errors, tick_length, tick)
                    if tick == end:
                        break
                control(plan, memory, width, plan.law, tick)
            for lane in range(n):
                for i in range(rows.size):
                    after[start + lane, i] = Z[rows[i], lane]
                for i in range(s.N_VARIABLES):
                    seen[start + lane, i] = Z[s.VAR + i, lane]
                for i in range(3):
                    seen[start + lane, s.N_VARIABLES + i] = Z[s.COMMANDS + i, lane]
                for i in range(4):
                    seen[start + lane, s.N_VARIABLES + 3 + i] = Z[s.CMD + i, lane]


def plant_rates(plan: FlightPlan, parameters: Floats, flight: Ints, states: Floats) -> tuple[Floats, Floats]:
    """Rates [point, 14] of the states before the actuators', and the tables' variables [point, variable].

    ``parameters`` [flight, parameter]; ``flight`` [point]; ``states`` [point, state].
    """
    points = len(states)
    rates, variables = np.empty((points, s.AILERON)), np.empty((points, len(VARIABLES)))
    arguments = make_kernel_plan(plan, parameters, Recording(0)), make_memory(LANES), np.asarray(flight, dtype=np.int64)
    probe_plant(*arguments, np.ascontiguousarray(states), np.arange(points), rates, variables)
    return rates, variables


def law_memory_rows(plan: FlightPlan) -> dict[str, int]:
    """Rows of the lane memory that the plan's law remembers, by name; the last commands are among them where
    it uses them.

    Raises InputError for a law in plain Python whose memory is no named tuple of numbers.
    """
    if plan.law == PYTHON:
        return {name: row for name, (row, _) in law_memory(plan).items()}
    return _MEMORY[plan.law]


def law_tick(plan: FlightPlan, tick: int, measured: Floats, memory: Floats) -> LawTick:
    """One tick of the plan's law, its limits off, past the first tick.

    ``measured`` [point, 10] in the order of the measured rows, ``memory`` [point, memory] in that of law_memory_rows.
    A law of the user's own keeps the limits that are in its code.
    """
    rows = np.array([*range(s.MEASURED, s.MEASURED + s.N_MEASURED), *law_memory_rows(plan).values(), FAULT], np.int64)
    free, later = _without_limits(plan, tick), max(tick, 1)
    before = np.hstack([measured, memory, np.zeros((len(measured), 1))])
    after, seen = _run_law(free, (later, later), np.empty((0, 0, 0)), rows, before)
    variables, guidance, command = np.split(seen, [len(VARIABLES), len(VARIABLES) + 3], axis=1)
    command[after[:, -1] > 0.0] = np.nan
    return LawTick(after[:, s.N_MEASURED : -1], command, variables, guidance)


def replay_law(plan: FlightPlan, parameters: Floats, states: Floats, tick: int) -> tuple[Floats, Floats]:
    """Measurement [flight, 10] of ``tick`` and the law's memory [flight, memory] then, as flown.

    ``states`` [flight, tick, state] were recorded at every tick up to this one at least. The memory of tick 0 is that
    of a flight that has always been at its start: its differentiators are at rest.
    """
    rows = np.arange(Z_ROWS)
    before = np.zeros((len(states), Z_ROWS))
    before[:, s.P : s.P + s.N_PARAMETERS] = parameters
    controls = (s.AILERON, s.RUDDER, s.ELEVATOR, s.ETA)
    before[:, s.CMD : s.CMD + 4] = plan.initial_state[list(controls)]
    kept = law_memory_rows(plan)
    if plan.law == PYTHON:
        before[:, list(kept.values())] = [start for _, start in law_memory(plan).values()]
    after, _ = _run_law(plan, (0, tick), states, rows, before)
    measured = after[:, s.MEASURED : s.MEASURED + s.N_MEASURED]
    memory = after[:, list(kept.values())]
    if tick == 0 and plan.law == "tlc":
        later, _ = _run_law(plan, (0, 1), np.repeat(states[:, :1], 2, axis=1), rows, before)
        resting = [name.startswith("differentiator") for name in kept]
        memory[:, resting] = later[:, list(kept.values())][:, resting]
    return measured, memory


def _run_law(
    plan: FlightPlan, ticks: tuple[int, int], states: Floats, rows: Ints, before: Floats
) -> tuple[Floats, Floats]:
    after, seen = np.empty_like(before), np.empty((len(before), _N_SEEN))
    with open_law(plan, LANES, memory_in_rows=True) as own:
        arguments = (
            make_kernel_plan(plan, nominal_parameters(), Recording(0))._replace(own=own),
            make_memory(LANES),
            *ticks,
        )
        probe_law(*arguments, np.ascontiguousarray(states), rows, np.arange(len(before)), before, after, seen)
    return after, seen


def _without_limits(plan: FlightPlan, tick: int) -> FlightPlan:
    """The plan as a law sees it that nothing limits; the row of ``tick`` 0 stands for tick 1, too."""
    constants = plan.vehicle.constants._replace(
        surface_limit=_WIDE, equivalence_ratio_min=-_WIDE, equivalence_ratio_max=_WIDE
    )
    settings = plan.settings.copy()
    if plan.law != PYTHON:
        settings[-3:] = -_WIDE, _WIDE, _WIDE  # lowest and highest angle of attack, bank: last in both laws' settings
    free = replace(plan, vehicle=plan.vehicle._replace(constants=constants), settings=settings)
    if tick > 0:
        return free
    reference, gains = (np.repeat(each[:1], 2, axis=0) for each in (plan.reference, plan.gains))
    return replace(free, timing=plan.timing._replace(ticks=1), reference=reference, gains=gains)


def undisturbed(parameters: Floats) -> Floats:
    """The same dispersions [flight, parameter] in air at rest."""
    calm = parameters.copy()
    nominal = nominal_parameters()[0]
    for name, i in PARAMETER_INDEX.items():
        if name.startswith("wind."):
            calm[:, i] = nominal[i]
    return calm
