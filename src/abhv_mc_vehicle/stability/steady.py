"""Steady flight: plans for level or turning flight, and trims of the dispersed vehicles.

Controllers that do not maintain the trim, e.g. without integrators, have other equilibria.

The limits of a custom controller are in its code. At the trim, a controller that does not maintain
it may be saturated: NASA's F-16 controller commands full aft stick at an altitude error of two
metres. Derivatives at a saturated point do not describe a closed loop.
"""

from dataclasses import replace

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.controller_file import Controller
from abhv_mc_vehicle.control.design.reference import (
    GuidanceTrim,
    make_mission_trim_tables,
    trim_along,
)
from abhv_mc_vehicle.control.law_file import USER_LAWS
from abhv_mc_vehicle.control.mission import Level, Mission
from abhv_mc_vehicle.flight.arguments import SavedFlights
from abhv_mc_vehicle.flight.fly import fly_until, nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.prepare import UserLaw, make_gains, make_plan
from abhv_mc_vehicle.flight.user_law import measured_count
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.laws.trim_lookup import GuidancePoints
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import NEVER, PARAMETER_INDEX, Vehicle
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.stability.point_slopes import (
    SWITCHES,
    Points,
    Slopes,
    find_period,
    newton_step,
    over_period,
    plant_slopes,
    switching,
)
from abhv_mc_vehicle.stability.points import AT_LIMIT, Found
from abhv_mc_vehicle.stability.probe import (
    as_axes,
    begin,
    custom_of,
    from_axes,
    held_at,
    law_memory_rows,
    mix_matrix,
    mixes,
    range_of,
    solved_states,
)
from abhv_mc_vehicle.user_code.design import DesignModel

_STEPS = 40
_EQUILIBRIUM = 1e-8  # tolerance of rates, changes of memory, and commands minus controls
_ROUNDING = 1e-8  # rounding error of the controller's slopes with respect to the measurement
_LOST = 1e-3  # relative slope below which the controller counts as saturated
_MEASURED = 11  # index of the first measurement in the result of plant_slopes


def leave_limits(plan: FlightPlan, points: Points, at_errors_zero: Floats) -> tuple[Points, Mask]:
    """Move saturated points to an equilibrium; also return a mask of points still saturated."""
    free = over_period(plan, points._replace(measured=at_errors_zero))
    limited = is_off_trim = _limited(plan, points, free)
    if plan.vehicle.constants.driven and not mixes(
        plan
    ):  # The mixing matrix alone does not determine the equilibrium.
        command = over_period(plan, points).value[:, points.memory.shape[1] :]
        is_off_trim = limited | (np.abs(command - points.controls) > _EQUILIBRIUM).any(axis=1)
    rows = np.flatnonzero(is_off_trim)
    if not rows.size:
        return points, limited
    some = points._replace(**{name: getattr(points, name)[rows] for name in Points._fields[:-1]})
    free = Slopes(free.value[rows], free.slope[rows], free.uneven[rows])
    equilibria, at_rest = _come_to_rest(plan, some, free)
    at_rest &= ~_limited(plan, equilibria, free)
    for name in ("path", "controls", "custom", "measured", "memory"):
        getattr(points, name)[rows[at_rest]] = getattr(equilibria, name)[at_rest]
    limited[rows] &= ~at_rest
    return points, limited


def _moves(plan: FlightPlan, points: Points) -> Mask:
    """Return a mask [point, input] of the inputs that the controller moves."""
    free = held_at(plan.vehicle, points.lane) == NEVER
    return np.hstack([free, np.ones((len(free), 1), bool)])


def _limited(plan: FlightPlan, points: Points, free: Slopes) -> Mask:
    present = over_period(plan, points)
    strength, free_strength = (
        _strengths(slopes.slope[:, points.memory.shape[1] :]) for slopes in (present, free)
    )
    lost = (free_strength > _ROUNDING) & (strength < _LOST * free_strength)
    return np.asarray((lost.any(axis=2) & _moves(plan, points)).any(axis=1))


def _strengths(slope: Floats) -> Floats:
    """Return norms [point, input, 2] of the slopes over speed, and over angles and rates."""
    angles = np.linalg.norm(slope[:, :, path.GAMMA : path.R + 1], axis=2)
    return np.stack([np.abs(slope[:, :, path.SPEED]), angles], axis=2)


def _come_to_rest(plan: FlightPlan, points: Points, free: Slopes) -> tuple[Points, Mask]:
    """Return equilibria with a constant heading rate, and a mask of the converged points."""
    m = points.memory.shape[1]
    n = points.measured.shape[1]
    law_measured = free.slope[:, :, :n]
    law_memory = free.slope[:, :, n:] - np.eye(free.slope.shape[1], m)
    moves = _moves(plan, points)
    k = 10 + points.controls.shape[1]
    own = solved_states(plan)
    seen = slice(_MEASURED, _MEASURED + n)
    columns = [*range(k), *(k + own)]  # columns of path, controls and custom states
    for iteration in range(_STEPS + 1):
        plant = plant_slopes(plan, points)
        frozen = (plant.slope[:, seen] == 0.0).all(axis=2)
        points = points._replace(measured=np.where(frozen, points.measured, plant.value[:, seen]))
        memory, command = np.split(over_period(plan, points).value, [m], axis=1)
        memory = np.where(find_period(plan).carried, points.memory, memory)
        rates = plant.value[:, :10].copy()
        rates[:, path.CHI] -= plan.reference[0, ref.HEADING_RATE]
        mismatch = np.where(moves, command - points.controls, 0.0)
        left = np.hstack([rates, memory - points.memory, mismatch, plant.value[:, seen.stop + own]])
        at_rest = np.abs(left).max(axis=1) < _EQUILIBRIUM
        if iteration == _STEPS or at_rest.all():
            break
        J = np.zeros((*left.shape, k + own.size + m))
        j = k + own.size
        law = slice(10, m + k)  # rows of the controller's memory and commands
        J[:, :10, :j] = plant.slope[:, :10, columns]
        J[:, law, :j] = law_measured @ plant.slope[:, seen][:, :, columns]
        J[:, law, j:] = law_memory
        J[:, 10 + m : m + k][~moves] = 0.0
        J[:, 10 + m : m + k, 10:k] -= np.eye(k - 10)
        J[:, m + k :, :j] = plant.slope[:, seen.stop + own][:, :, columns]
        step = np.where(at_rest[:, None], 0.0, newton_step(J, left))
        custom = points.custom.copy()
        custom[:, own] -= step[:, k:j]
        points = points._replace(
            path=points.path - step[:, :10],
            controls=points.controls - step[:, 10:k],
            custom=custom,
            memory=points.memory - step[:, j:],
        )
    return points, at_rest


_ITERATIONS = 25
_AT_REST = 1e-12  # largest change of the controller's memory in a tick at a trim
_STILL = 1e-10  # step of the memory below which the iteration has converged
# change of the memory per tick that shows the lack of an equilibrium, such as the change from
# integrating 6e-4 deg of sideslip
_GROWS = 1e-7
# weight of constant memory relative to the weight of equal commands and controls, if no memory
# satisfies both conditions
_RESTING = 1e5
_BALANCED = 1e-9  # largest rate at a trim, rad/s2 and similar units
_UNKNOWNS = [
    path.ALPHA,
    path.BETA,
    path.BANK,
    path.P,
    path.Q,
    path.R,
    10,
    11,
    12,
    13,
]  # unknowns of the trim: path coordinates, then the three axes and the engine
_LARGEST = np.array(
    [0.05, 0.05, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.3]
)  # maximum Newton step of each unknown
_EXPECTED = slice(
    1, 11
)  # rows of plant_slopes: all rates except the altitude rate, and aerodynamic sideslip
_BEYOND = "the trim exceeds the limits of surfaces or engine"


def make_steady_plan(
    vehicle: Vehicle,
    mission: Mission,
    controller: Controller,
    name: str,
    bank: float = 0.0,
    user_code: UserLaw | None = None,
) -> FlightPlan:
    """Return a plan of steady flight with the conditions and gains at the mission's start.

    `bank` (rad) is the bank of the guidance trim in a steady turn; 0 means straight flight.
    `user_code` belongs to a custom controller. Raise InputError if no steady turn has this bank.
    """
    level = mission.model_copy(
        update={"manoeuvre": Level(kind="level"), "duration": 2.0 / controller.rate}
    )
    plan = make_plan(vehicle, level, controller, name, user_code=user_code)
    trim_tables = make_mission_trim_tables(mission, vehicle)
    row = plan.reference[0].copy()
    heading_rate = _turn_of_bank(vehicle, plan, row, bank) if bank else 0.0
    nominal = _trim_turn(vehicle, plan, row, heading_rate)
    row[ref.HEADING_RATE] = heading_rate
    row[ref.ANGLE_OF_ATTACK] = nominal.angle_of_attack[0]
    row[ref.BANK] = nominal.bank[0]
    row[ref.EQUIVALENCE_RATIO] = nominal.equivalence_ratio[0]
    row[ref.ELEVATOR] = nominal.elevator[0]
    reference = np.tile(row, (3, 1))
    reference[:, ref.TIME] = plan.reference[:3, ref.TIME]
    _, gains, _ = make_gains(
        controller, user_code, DesignModel(vehicle, level, reference, trim_tables)
    )
    return replace(plan, reference=reference, gains=gains, trim_tables=trim_tables)


def _trim_turn(
    vehicle: Vehicle, plan: FlightPlan, row: Floats, heading_rate: float
) -> GuidanceTrim:
    conditions = row[
        [ref.SPEED, ref.DENSITY, ref.SOUND_SPEED, ref.GRAVITY, ref.RADIUS, ref.LATITUDE]
    ]
    values = *conditions, 0.0, row[ref.HEADING], 0.0, 0.0, row[ref.SPEED] * heading_rate
    points = GuidancePoints(*np.array(values)[:, None])
    return trim_along(
        vehicle, plan.trim_tables, points, vehicle.constants.mass_start, plan.timing.tick
    )


def _turn_of_bank(vehicle: Vehicle, plan: FlightPlan, row: Floats, bank: float) -> float:
    """Return the heading rate (rad/s) of the steady turn with the given bank."""
    from scipy.optimize import brentq

    def off(heading_rate: float) -> float:
        return float(_trim_turn(vehicle, plan, row, heading_rate).bank[0] - bank)

    guess = float(row[ref.GRAVITY] / row[ref.SPEED] * np.tan(bank))
    ends = sorted((0.2 * guess, 2.0 * guess))
    if off(ends[0]) * off(ends[1]) > 0.0:
        raise InputError(
            "--bank",
            f"found {np.rad2deg(bank):g} deg",
            "a bank at which this vehicle can turn steadily",
        )
    return float(brentq(off, *ends, xtol=1e-14))


def steady_air(parameters: Floats) -> Floats:
    """Return dispersions [flight, parameter] without gusts and turbulence.

    The steady wind is unchanged.
    """
    steady = parameters.copy()
    nominal = nominal_parameters()[0]
    for name, i in PARAMETER_INDEX.items():
        if name.startswith(("wind.gust", "wind.turbulence")):
            steady[:, i] = nominal[i]
    return steady


def trim_points(plan: FlightPlan, parameters: Floats) -> Found:
    """Return the trims of the dispersed vehicles for a plan of :func:`make_steady_plan`.

    `parameters` has shape [flight, parameter]. Steady wind and failures at the start are included.
    Altitude, speed and heading equal the reference, flight path angle and aerodynamic sideslip are
    zero, and all rates except the heading rate vanish. A stuck aileron or rudder leaves the
    sideslip free. The controller is in equilibrium with zero errors; if there is no equilibrium,
    the point has a fault.
    """
    row = plan.reference[0]
    _, begun = begin(plan, fly_until(plan, steady_air(parameters), 0))
    _, lane = begin(
        plan, SavedFlights(1, begun)
    )  # A measurement that fails at the start is frozen from the second tick on.
    # flights with a failed engine, whose thrust is assumed to have decayed
    out = lane[:, s.ENGINE_FAILED] > 0.0
    lane[out, s.ENGINE_THRUST] = lane[out, s.parameter_row("failure.engine.thrust")]
    count = len(lane)
    nothing = np.empty((len(lane), 0))
    stuck_at = held_at(plan.vehicle, lane)
    mix = mix_matrix(plan.vehicle)
    stuck = np.pad(stuck_at != NEVER, ((0, 0), (0, 1)))
    stuck_at = np.pad(stuck_at, ((0, 0), (0, 1)))
    coordinates = np.zeros((count, 14))
    motion = coordinates[:, :10]  # view, which the iteration below changes
    coordinates[:, path.ALTITUDE] = row[ref.ALTITUDE]
    coordinates[:, path.SPEED] = row[ref.SPEED]
    coordinates[:, path.CHI] = row[ref.HEADING]
    coordinates[:, path.ALPHA] = row[ref.ANGLE_OF_ATTACK]
    coordinates[:, path.BANK] = row[ref.BANK]
    coordinates[:, 12:] = row[ref.ELEVATOR], row[ref.EQUIVALENCE_RATIO]

    def controls(coordinates: Floats) -> Floats:
        return np.where(stuck, stuck_at, from_axes(plan.vehicle, coordinates[:, 10:]))

    latitude = lane[:, s.X + s.LATITUDE]
    mass = lane[:, s.X + s.MASS]
    custom = custom_of(plan.vehicle, lane)
    points = Points(
        path=motion,
        controls=controls(coordinates),
        latitude=latitude,
        mass=mass,
        measured=nothing,
        memory=nothing,
        lane=lane,
        custom=custom,
        tick=1,
    )
    last = _EXPECTED.stop + measured_count(
        plan
    )  # index of the first rate of a custom state, after the measurement
    own = solved_states(plan)
    expected = [*range(_EXPECTED.start, _EXPECTED.stop), *(last + own)]
    # mixing matrices [point, input, axis] with zero rows for stuck inputs
    moved = np.where(stuck[:, :, None], 0.0, mix)
    lateral = np.linalg.matrix_rank(moved[:, :, :2]) == np.linalg.matrix_rank(mix[:, :2])
    holds = np.ones((count, len(expected)), bool)
    holds[:, 9] = lateral
    user_law = plan.commanding_law in USER_LAWS
    at_errors_zero = (
        plant_slopes(plan, points).value[:, _EXPECTED.stop : last] if user_law else nothing
    )
    for _ in range(_ITERATIONS):
        present = points._replace(path=motion, controls=controls(coordinates), custom=custom)
        plant = plant_slopes(plan, present)
        left = plant.value[:, expected]
        left[:, path.CHI - 1] -= row[ref.HEADING_RATE]
        left[~holds] = 0.0
        slope = plant.slope[:, expected]
        end = 10 + mix.shape[0]
        parts = slope[:, :, _UNKNOWNS[:-4]], slope[:, :, 10:end] @ moved, slope[:, :, end + own]
        J = np.concatenate(parts, axis=2)
        J[~holds] = 0.0
        step = newton_step(J, left)
        step[np.abs(left).max(axis=1) < 0.01 * _BALANCED] = 0.0
        if not step.any():
            break
        coordinates[:, _UNKNOWNS] -= np.clip(step[:, : _LARGEST.size], -_LARGEST, _LARGEST)
        custom[:, own] -= step[:, _LARGEST.size :]
    limits = [np.tile(limit, (count, 1)) for limit in range_of(plan.vehicle)]
    for limit in limits:
        limit[:, :-1] *= lane[:, [s.parameter_row("actuator.deflection_limit")]]
    limits[1][:, -1] *= lane[:, s.parameter_row("engine.equivalence_ratio_limit")]
    positions = controls(coordinates)
    beyond = ((positions < limits[0]) | (positions > limits[1])).any(axis=1)
    off = ~(np.abs(left).max(axis=1) < _BALANCED)
    measured = plant.value[:, _EXPECTED.stop : last].copy()
    frozen = (plant.slope[:, _EXPECTED.stop : last] == 0.0).all(axis=2)
    # A frozen measurement equals its true value in steady flight.
    measured[:, :10] = np.where(frozen[:, :10], motion, measured[:, :10])
    points = points._replace(path=motion, controls=positions, custom=custom, measured=measured)
    memory, grows, switches = _memory_at_rest(plan, points)
    points = points._replace(memory=memory)
    points, limited = (
        leave_limits(plan, points, at_errors_zero) if user_law else (points, np.zeros(count, bool))
    )
    beta = np.rad2deg(measured[:, path.BETA])
    unsettled = [_unsettled(plan.controller, angle) for angle in beta.tolist()]
    reasons = ["no trim was found", _BEYOND, SWITCHES, unsettled, AT_LIMIT]
    return Found(points, np.select([off, beyond, switches, grows, limited], reasons, "").tolist())


def _unsettled(controller: str, sideslip: float) -> str:
    message = f"{controller} has no equilibrium: its integrated error keeps growing"
    return (
        f"{message} (it measures {sideslip:.3g} deg of sideslip)"
        if abs(sideslip) > 1e-4
        else message
    )


def _memory_at_rest(plan: FlightPlan, points: Points) -> tuple[Floats, Mask, Mask]:
    """Return the equilibrium memory, and masks [point] of growing memory and of switching.

    The memory [point, memory] is constant and the commands equal the points' controls. If no memory
    satisfies both conditions, as for controllers without integrators, the memory is constant and
    the commands are as close to the controls as possible. All conditions apply over the
    controller's period: counters and clocks may advance, and commands are averaged.
    """
    period = find_period(plan)
    count = len(law_memory_rows(plan))
    memory = np.zeros((len(points.path), count))
    grows = np.zeros(len(points.path), bool)
    memory[:, period.carried] = period.start[period.carried]
    uneven = grows
    last = [s.CMD <= row < s.CMD + 4 for row in law_memory_rows(plan).values()]
    memory[:, last] = as_axes(plan.vehicle, points.controls)[:, : sum(last)]
    for _ in range(8 if count else int(plan.law in USER_LAWS)):
        law = over_period(plan, points._replace(memory=memory))
        uneven = switching(plan, law)
        if not count:
            break
        left = law.value - np.hstack([memory, points.controls])
        left[:, :count][:, period.carried] = 0.0
        grows = np.abs(left[:, :count]).max(axis=1) > _GROWS
        if np.abs(left).max() < _AT_REST:
            break
        J = law.slope[:, :, points.measured.shape[1] :].copy()
        J[:, :count] -= np.eye(count)
        left[:, :count] *= _RESTING
        J[:, :count] *= _RESTING
        step = newton_step(J, left)
        memory -= step
        if period.ticks > 1 and np.abs(step).max(initial=0.0) < _STILL:
            break
    return memory, grows, uneven
