"""Vectorized evaluation of the compiled plant and controllers at single points.

The inputs of the plant in a linear model are the surfaces or effectors, and the engine.

Linearization differentiates these functions, so the linear model represents the simulated code.
Evaluation starts from the kernel's memory of a flight, which includes the vehicle's dispersions and
failures at the tick.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints, Mask
from abhv_mc.custom_code.child import in_child
from abhv_mc.flights.blocks import Recording
from abhv_mc_vehicle.control.law_file import USER_LAWS
from abhv_mc_vehicle.flight.arguments import SavedFlights, make_kernel_plan
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.flight.native_check import check_states
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.user_law import law_memory, measured_count, open_law, open_vehicle
from abhv_mc_vehicle.kernel.flight.interface import (
    LANES,
    O_ROWS,
    SAVED_ROWS,
    Z_ROWS,
    KernelPlan,
    make_memory,
)
from abhv_mc_vehicle.kernel.jit import is_cached
from abhv_mc_vehicle.kernel.laws.columns import N_LIMITS
from abhv_mc_vehicle.kernel.laws.tlc import D_ALPHA, I_ALTITUDE
from abhv_mc_vehicle.kernel.laws.user import FAULT
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import HIGH, LOW
from abhv_mc_vehicle.kernel.plant.actuators import MOVES, N_EFFECTOR_ROWS, POSITION
from abhv_mc_vehicle.kernel.plant.vehicle import AXES, EFFECTORS, NEVER, VARIABLES, Vehicle
from abhv_mc_vehicle.kernel.stability.probes import (
    PlantAnswer,
    make_probe_begin,
    make_probe_law,
    make_probe_plant,
)
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.user_code.effector_commands import commands_effectors
from abhv_mc_vehicle.user_code.law_interface import COMMAND_FIELDS
from abhv_mc_vehicle.user_code.vehicle_functions import find_code
from abhv_mc_vehicle.vehicle.actuators import name_effectors, surface_list, surface_mix
from abhv_mc_vehicle.vehicle.vehicle_code import name_states

INPUTS = COMMAND_FIELDS[:4]  # aileron, rudder, elevator and equivalence_ratio


def name_inputs(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of the plant's inputs, with the engine last."""
    return (*name_effectors(vehicle), INPUTS[3]) if vehicle.constants.driven else INPUTS


def plant_states(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of the plant's states.

    The states are path coordinates, position and rate of each input, and custom states.
    """
    return (
        *path.COORDINATES,
        *(f"{name}{suffix}" for name in name_inputs(vehicle) for suffix in ("", "_rate")),
        *(f"state.{name}" for name, *_ in name_states(find_code(vehicle))),
    )


def plant_units(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the units of the plant's states."""
    surfaces = len(name_inputs(vehicle)) - 1
    own = (unit for _, unit, _ in name_states(find_code(vehicle)))
    return (*path.UNITS, *["rad", "rad/s"] * surfaces, "-", "1/s", *own)


def solved_states(plan: FlightPlan) -> Ints:
    """Return the indices of the custom states whose values a trim determines.

    A trim determines the custom states that have no initial value.
    """
    states = plan.vehicle_code.states if plan.vehicle_code else ()
    return np.array([i for i, state in enumerate(states) if state.start is None], np.int64)


def custom_of(vehicle: Vehicle, lane: Floats) -> Floats:
    """Return the custom states [point, state] in the kernel's memory `lane` [point, row]."""
    return np.ascontiguousarray(lane[:, s.CUSTOM_STATE : s.CUSTOM_STATE + vehicle.foreign.states])


def mixes(plan: FlightPlan) -> bool:
    """Return whether the controller commands axes that are mixed into effector commands."""
    own = plan.law in USER_LAWS and plan.source is not None and commands_effectors(plan.source)
    return bool(plan.vehicle.constants.driven) and not own


def mix_matrix(vehicle: Vehicle) -> Floats:
    """Return the matrix [input, 4] that maps the three axes and the engine to the inputs."""
    mix = np.pad(surface_mix(vehicle), ((0, 1), (0, 1)))
    mix[-1, -1] = 1.0
    return mix


def from_axes(vehicle: Vehicle, axes: Floats) -> Floats:
    """Convert positions or commands of axes and engine [point, 4] to inputs [point, input]."""
    return axes @ mix_matrix(vehicle).T if vehicle.constants.driven else axes


def as_axes(vehicle: Vehicle, inputs: Floats) -> Floats:
    """Convert positions or commands of inputs [point, input] to axes and engine [point, 4]."""
    return inputs @ np.linalg.pinv(mix_matrix(vehicle)).T if vehicle.constants.driven else inputs


def range_of(vehicle: Vehicle) -> tuple[Floats, Floats]:
    """Return the lowest and highest nominal position of each input [input]."""
    actuators = vehicle.actuators[surface_list(vehicle)]
    return actuators[:, LOW].copy(), actuators[:, HIGH].copy()


def held_at(vehicle: Vehicle, lane: Floats) -> Floats:
    """Return the deflections [point, input - 1] of stuck inputs; NEVER for all others."""
    first = s.STUCK_EFFECTOR if vehicle.constants.driven else s.STUCK_SURFACE
    return lane[:, first : first + len(surface_mix(vehicle))]


def sticks_here(vehicle: Vehicle, lane: Floats) -> Mask:
    """Return a mask [point, input - 1] of inputs that are stuck at their present position."""
    stuck = held_at(vehicle, lane) != NEVER
    names = EFFECTORS[: len(vehicle.effector_mix)] if vehicle.constants.driven else INPUTS[:3]
    for i, name in enumerate(names):
        stuck[:, i] &= lane[:, s.parameter_row(f"failure.{name}.stuck_at")] == NEVER
    return stuck


def actuator_columns(vehicle: Vehicle) -> list[int]:
    """Return the columns of saved flights with each input's position and rate, alternating."""
    first = s.X + s.AILERON, s.X + s.AILERON_RATE
    pairs = [(first[0] + i, first[1] + i) for i in range(3)]
    if vehicle.constants.driven:
        starts = (Z_ROWS + O_ROWS + e * N_EFFECTOR_ROWS for e in range(len(vehicle.effectors.mix)))
        pairs = [(start + POSITION, start + MOVES) for start in starts]
    return [column for pair in (*pairs, (s.X + s.ETA, s.X + s.ETA_RATE)) for column in pair]


# memory rows of the built-in controllers, including the previous commands if a controller uses them
_INTEGRALS = ("altitude", "flight_path_angle", "heading", "speed", *path.COORDINATES[4:])
_DIFFERENTIATORS = ("angle_of_attack", "bank", "roll_rate", "pitch_rate", "yaw_rate")
_MEMORY = {
    "tlc": {
        **{f"integral_of_{name}": I_ALTITUDE + i for i, name in enumerate(_INTEGRALS)},
        **{f"differentiator_of_{name}": D_ALPHA + i for i, name in enumerate(_DIFFERENTIATORS)},
        **{f"last_{name}": s.CMD + i for i, name in enumerate(AXES)},
    },
    "lqr": {},
}
_LONGEST = 600.0  # maximum computing time of the ticks of a compiled custom controller, s
_WIDE = 1e6  # limit larger than any command, for controllers linearized without limits
# number of recorded values: table variables, guidance commands and actuator commands
_N_SEEN = len(VARIABLES) + 7


class LawTick(NamedTuple):
    """Result of one controller tick for a measurement."""

    memory: Floats  # memory after the tick [point, memory]
    command: Floats  # commands [point, input]; NaN if a custom controller fails
    variables: Floats  # variables of the table look-up [point, variable]
    guidance: Floats  # commanded flight path angle, angle of attack and bank [point, 3]

    @property
    def guided(self) -> Floats:
        """Variables [point, variable] at which the guidance looks up the trim."""
        variables = self.variables.copy()
        variables[:, VARIABLES.index("angle_of_attack")] = self.guidance[:, 1]
        variables[:, VARIABLES.index("equivalence_ratio")] = self.command[:, -1]
        return variables


@cache
def choose_probe(make: Callable[[bool], Any], lean: bool) -> Any:
    """Return the probe that `make` compiles; a cached full probe also serves as a lean one."""
    if not lean:
        return make(False)
    full = choose_probe(make, False)
    return full if is_cached(full) else make(True)


def compile_probes(plan: FlightPlan) -> None:
    """Compile or load the probes by calling them without points."""
    _, lane = begin(plan, SavedFlights(0, np.empty((0, SAVED_ROWS))))
    states = np.empty((0, s.N_STATES)), np.empty((0, plan.vehicle.foreign.states))
    ask_plant(plan, lane, 0, np.empty(0, np.int64), *states)
    law_tick(
        plan, 1, np.empty((0, measured_count(plan))), np.empty((0, len(law_memory_rows(plan))))
    )


def begin(plan: FlightPlan, saved: SavedFlights) -> tuple[Floats, Floats]:
    """Return the lane memories [flight, row] with active failures, and the measurement."""
    before = np.ascontiguousarray(saved.rows[:, :Z_ROWS])
    numbers = np.arange(len(before))
    # memory [flight, row] of the effector actuators; no rows if none exist
    first = Z_ROWS + O_ROWS if plan.vehicle.constants.driven else saved.rows.shape[1]
    moving = np.ascontiguousarray(saved.rows[:, first:])
    if measured_count(plan) == s.N_SEEN:  # specific force at the tick, as sensors measure it
        states = before[:, s.X : s.X + s.N_STATES]
        positions = np.pad(moving[:, POSITION::N_EFFECTOR_ROWS], ((0, 0), (0, 1)))
        effectors_at = positions if moving.size else None
        measured = ask_plant(
            plan, before, saved.tick, numbers, states, effectors_at=effectors_at
        ).measured
        before[:, s.SPECIFIC_X : s.SPECIFIC_X + 3] = measured[:, -3:]
        before[:, s.SENSED + s.N_SEEN - 3 : s.SENSED + s.N_SEEN] = 0.0
    sensed = np.empty_like(before)
    acting = np.empty_like(before)
    kernel_plan = _kernel_plan(plan)
    with open_vehicle(plan, LANES) as vehicle:
        arguments = kernel_plan._replace(user_code=vehicle), make_memory(LANES), before, moving
        choose_probe(make_probe_begin, plan.lean)(*arguments, numbers, saved.tick, sensed, acting)
    return sensed, acting


def ask_plant(
    plan: FlightPlan,
    lane: Floats,
    tick: int,
    flight: Ints,
    states: Floats,
    custom: Floats | None = None,
    *,
    hold_slow: bool = False,
    effectors_at: Floats | None = None,
) -> PlantAnswer:
    """Evaluate the plant of each `flight` [point] at `states` [point, state].

    `lane` [flight, row] is the memory of the flights. `custom` [point, state] contains custom
    states, by default those of `lane`. If `hold_slow`, effectors that a failure slows down keep the
    positions given by the mixed surface positions in `states`. `effectors_at` [point, input]
    contains the positions of effectors with actuators.
    """
    points = len(states)
    count = measured_count(plan)
    if custom is None:
        first = s.CUSTOM_STATE
        custom = lane[flight, first : first + plan.vehicle.foreign.states]
    sizes = s.AILERON, custom.shape[1], len(VARIABLES), count
    answer = PlantAnswer(*(np.empty((points, size)) for size in sizes))
    kernel_plan = _kernel_plan(plan)
    rows = np.ascontiguousarray(lane[:, : s.LAW])
    positions = (
        np.empty((points, 0))
        if effectors_at is None
        else np.ascontiguousarray(effectors_at[:, :-1])
    )
    numbers = (
        np.asarray(flight, np.int64),
        np.ascontiguousarray(states),
        np.ascontiguousarray(custom),
        positions,
        np.arange(points),
    )
    with open_vehicle(plan, LANES) as vehicle:
        user_code = vehicle._replace(more=int(count > s.N_MEASURED))
        arguments = kernel_plan._replace(user_code=user_code), make_memory(LANES), hold_slow
        choose_probe(make_probe_plant, plan.lean)(*arguments, rows, *numbers, tick, answer)
    return answer


def law_memory_rows(plan: FlightPlan) -> dict[str, int]:
    """Return the rows of the lane memory that the controller uses, by name.

    Raise InputError if the rows of a custom controller are unknown.
    """
    if plan.law == "fmu":
        check_states(plan)
    own = {}
    if plan.law in USER_LAWS:
        own = {name: row for name, (row, _) in law_memory(plan).items()}
    return own | _MEMORY.get(plan.commanding_law, {})


def _law_rows(plan: FlightPlan, measured: int) -> Ints:
    """Return the rows of a controller's measurement and memory, and of its fault."""
    memory = law_memory_rows(plan).values()
    return np.array([*range(s.MEASURED, s.MEASURED + measured), *memory, FAULT], np.int64)


def law_tick(plan: FlightPlan, tick: int, measured: Floats, memory: Floats) -> LawTick:
    """Run one controller tick (not the first), without limits except those in custom code.

    `measured` has shape [point, measured] and `memory` [point, memory].
    """
    count = measured.shape[1]
    rows = _law_rows(plan, count)
    free = _without_limits(plan, min(tick, 1))
    later = max(tick, 1)
    before = np.hstack([measured, memory, np.zeros((len(measured), 1))])
    (after,), (seen,) = _run_law(free, later, rows, before)
    command = _commands(plan, seen)
    command[after[:, -1] > 0.0] = np.nan
    return LawTick(
        after[:, count:-1],
        command,
        seen[:, : len(VARIABLES)],
        seen[:, len(VARIABLES) : len(VARIABLES) + 3],
    )


def _commands(plan: FlightPlan, seen: Floats) -> Floats:
    """Return actuator commands [..., input] from the values recorded by the probe."""
    command = from_axes(plan.vehicle, seen[..., _N_SEEN - 4 : _N_SEEN])
    if plan.vehicle.constants.driven and not mixes(plan):
        command[..., :-1] = seen[..., _N_SEEN:]
    return command


def law_at(plan: FlightPlan, sensed: Floats, tick: int) -> Floats:
    """Return the controller's memory [flight, memory] before its tick.

    `sensed` is a result of :func:`begin`; at tick 0, differentiators are at rest.
    """
    memory_rows = law_memory_rows(plan)
    memory = sensed[:, list(memory_rows.values())]
    if tick > 0:
        return memory
    if plan.law in USER_LAWS:
        starts = [start for _, start in law_memory(plan).values()]
        memory[:, : len(starts)] = starts
    rows = np.arange(Z_ROWS)
    resting = [name.startswith("differentiator") for name in memory_rows]
    if any(resting):
        memory[:, resting] = _run_law(plan, 0, rows, sensed)[0][0][:, list(memory_rows.values())][
            :, resting
        ]
    return memory


def run_law(plan: FlightPlan, start: Floats, ticks: int, follow: Ints, change: Floats) -> Floats:
    """Return memory and unlimited commands [tick, point, memory + input] after each tick.

    `start` has shape [point, measured + memory]; each point continues from the result of point
    `follow` [point], plus `change` [point, measured + memory].
    """
    count = start.shape[1] - len(law_memory_rows(plan))
    rows = _law_rows(plan, count)
    start, change = (np.pad(array, ((0, 0), (0, 1))) for array in (start, change))
    after, seen = _run_law(_without_limits(plan, 1), 0, rows, start, ticks, (follow, change))
    return np.concatenate([after[:, :, count:-1], _commands(plan, seen)], axis=2)


def _run_law(
    plan: FlightPlan,
    tick: int,
    rows: Ints,
    before: Floats,
    ticks: int = 1,
    goes_on: tuple[Ints, Floats] | None = None,
) -> tuple[Floats, Floats]:
    """Return memory rows [tick, point, row] after each tick, and the recorded values.

    `goes_on` contains `follow` and `change` of :func:`run_law`.
    """
    if plan.must_run_in_child:
        return in_child(_run_law, plan, tick, rows, before, ticks, goes_on, limit=_LONGEST)
    width = _N_SEEN + len(plan.vehicle.effectors.mix) * int(plan.vehicle.constants.driven)
    after = np.empty((ticks, *before.shape))
    seen = np.empty((ticks, len(before), width))
    with open_law(plan, LANES, memory_in_rows=True) as user_code:
        kernel_plan = _kernel_plan(plan)._replace(user_code=user_code)
        memory = make_memory(LANES)
        numbers = np.arange(len(before))
        probe = choose_probe(make_probe_law, plan.lean)
        for i in range(ticks):
            if i and goes_on is not None:
                before = after[i - 1][goes_on[0]] + goes_on[1]
            probe(
                kernel_plan,
                memory,
                tick + i,
                rows,
                numbers,
                np.ascontiguousarray(before),
                after[i],
                seen[i],
            )
    return after, seen


@lru_cache(maxsize=4)
def _kernel_plan(plan: FlightPlan) -> KernelPlan:
    """Return the plan for the kernel; linearization calls the kernel a hundred times."""
    return make_kernel_plan(plan, nominal_parameters(), Recording(0))


@lru_cache(maxsize=4)
def _without_limits(plan: FlightPlan, tick: int) -> FlightPlan:
    """Return the plan without command limits; for tick 0, its first row applies to two ticks."""
    constants = plan.vehicle.constants._replace(
        surface_limit=_WIDE, equivalence_ratio_min=-_WIDE, equivalence_ratio_max=_WIDE
    )
    settings = plan.settings.copy()
    if plan.commanding_law not in USER_LAWS:
        settings[-N_LIMITS:] = (-_WIDE, _WIDE, _WIDE, *(3 * (-_WIDE, _WIDE)))
    free = replace(plan, vehicle=plan.vehicle._replace(constants=constants), settings=settings)
    if tick > 0:
        return free
    reference, gains = (np.repeat(table[:1], 2, axis=0) for table in (plan.reference, plan.gains))
    return replace(free, timing=plan.timing._replace(ticks=1), reference=reference, gains=gains)
