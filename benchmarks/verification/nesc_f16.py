"""F-16 check-cases 11 to 16 of NASA/TM-2015-218675: trims and flights with autopilot."""

import functools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.source import read_source
from abhv_mc.flights.timing import Timing
from abhv_mc.io.documents import StrictModel, read_document, validate
from abhv_mc.io.units import Angle, Length, Speed, Time, parse_in_unit
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.prepare import local_frame_rate
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.numerics.quaternion import from_euler, rotate_to_body
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere
from abhv_mc_vehicle.plant.trim import FlightPoint, trim
from abhv_mc_vehicle.user_code.law_interface import Measured
from abhv_mc_vehicle.user_code.load_law import load_law
from abhv_mc_vehicle.user_code.module import Law
from abhv_mc_vehicle.user_code.settings import CommandSteps
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from benchmarks.verification.fly_recording import make_replay_plan, replay
from benchmarks.verification.nesc_cases import ELLIPSOID

RATE = 500.0  # rate in Hz of the autopilot, which is continuous in the cases
_TRIM_STEP = 1e-3  # time step in s over which the trim computes accelerations
_FULL_STICK = math.radians(-25.0)  # elevator deflection in rad at full aft stick


class Step(StrictModel):
    """Step of a command at a specified time."""

    at: Time
    by: str | float


class AircraftCase(StrictModel):
    """F-16 check-case; commands without units have the units of the controller."""

    altitude: Length
    velocity: tuple[Speed, Speed]  # velocity north and east
    latitude: Angle
    longitude: Angle
    law: str
    engaged: bool  # whether the control law is engaged when the vehicle is trimmed
    commands: dict[str, float] = {}
    steps: dict[str, Step] = {}


class AircraftCases(StrictModel):
    """File of F-16 check-cases by number."""

    cases: dict[str, AircraftCase]


@functools.cache
def read_aircraft_cases() -> dict[str, AircraftCase]:
    """Return the F-16 check-cases 11 to 16 by number."""
    document = read_document(shipped_configs() / "vehicle" / "f16" / "check_cases.yaml")
    return validate(document, AircraftCases).cases


def fly_aircraft(name: str, duration: float) -> Floats:
    """Simulate a case at RATE with the imported law and return states [tick, state]."""
    case = read_aircraft_cases()[name]
    folder = shipped_configs() / "vehicle"
    vehicle = load_vehicle(folder / "f16.yaml")
    start = solve_start(vehicle, case)
    law = _read_law(folder / "f16" / f"{case.law}.py")
    timing = Timing(1.0 / RATE, 1, math.ceil(duration * RATE - 1e-6))
    steps = make_steps(law, case, start)
    plan = make_law_plan(vehicle, start, timing, law, steps, heading=heading_of(case))
    return fly(plan, nominal_parameters(), record_every=1, keep_states=True).states[0]


@functools.cache
def _read_law(path: Path) -> Law:
    return load_law(read_source(path))


def heading_of(case: AircraftCase) -> float:
    """Return the initial heading (rad) of the velocity."""
    return math.atan2(case.velocity[1], case.velocity[0])


def solve_start(vehicle: Vehicle, case: AircraftCase) -> Floats:
    """Return the trimmed initial state, with zero axial, normal and pitch acceleration."""
    from scipy.optimize import root

    north, east = case.velocity
    heading = heading_of(case)
    near = trim(
        vehicle,
        ELLIPSOID,
        FlightPoint(case.altitude, math.hypot(north, east), 0.0, case.latitude, heading),
    )
    frame_rate = local_frame_rate(ELLIPSOID, case.altitude, case.latitude, north, east)

    def state(controls: Floats) -> Floats:
        alpha, elevator, throttle = controls
        attitude = from_euler(heading, alpha, 0.0)
        x = np.zeros(s.N_STATES)
        x[s.ALTITUDE], x[s.LONGITUDE], x[s.LATITUDE] = case.altitude, case.longitude, case.latitude
        x[s.Q0 : s.Q3 + 1] = attitude
        x[s.U : s.W + 1] = rotate_to_body(*attitude, north, east, 0.0)
        x[s.ROLL_RATE : s.YAW_RATE + 1] = rotate_to_body(*attitude, *frame_rate)
        x[s.MASS], x[s.ELEVATOR], x[s.ETA] = vehicle.constants.mass_start, elevator, throttle
        return x

    def accelerations(controls: Floats) -> Floats:
        constant_controls = np.tile([0.0, 0.0, *controls[1:]], (2, 1))
        plan = make_replay_plan(
            vehicle, ELLIPSOID, state(controls), constant_controls, Timing(_TRIM_STEP, 1, 1)
        )
        first, second = replay(plan)
        return (second - first)[[s.U, s.W, s.PITCH_RATE]] / _TRIM_STEP

    solution = root(
        accelerations, [near.angle_of_attack, near.elevator, near.equivalence_ratio], tol=1e-12
    )
    return state(solution.x)


def make_steps(law: Law, case: AircraftCase, start: Floats) -> CommandSteps:
    """Return the commands: initial course and airspeed, and the steps of the case.

    The stick and throttle commands are solved for with the autopilot off, as the autopilot's notes
    require. In the variants of case 13, these commands also compensate for the difference between
    the autopilot's design point and the trim, because in the published flights the elevator does
    not move at the start.
    """
    speed = math.hypot(*case.velocity)
    equivalent = speed * math.sqrt(atmosphere(case.altitude)[0] / atmosphere(0.0)[0])
    alpha, heading = math.atan2(start[s.W], start[s.U]), heading_of(case)
    command_values = {
        "keasCmd": equivalent,
        "altCmd": case.altitude,
        "baseChiCmd": heading,
        **case.commands,
    }
    command_values |= {
        "throttleTrim": float(start[s.ETA]),
        "longStkTrim": float(start[s.ELEVATOR]) / _FULL_STICK,
    }
    names = law.commands._fields
    seen = dict.fromkeys(Measured._fields, 0.0) | {
        "altitude": case.altitude,
        "angle_of_attack": alpha,
        "equivalent_airspeed": equivalent,
        "pitch": alpha,
        "yaw": heading,
        "latitude": case.latitude,
        "longitude": case.longitude,
        "pitch_rate": float(start[s.PITCH_RATE]),
    }
    response = law.function(
        Measured(**seen), law.commands(**{name: command_values.get(name, 0.0) for name in names})
    )
    if case.engaged:
        command_values["longStkTrim"] += (
            float(start[s.ELEVATOR]) - response.elevator
        ) / _FULL_STICK
        command_values["throttleTrim"] += float(start[s.ETA]) - response.throttle
    times, values = [], []
    for name in names:
        value = command_values.get(name, 0.0)
        step = case.steps.get(name)
        step_time = step.at if step else 0.0
        gain = parse_in_unit(step.by, law.mark.units.get(name, "-")) if step else 0.0
        times.append(np.array([0.0, step_time] if gain else [0.0]))
        values.append(np.array([value, value + gain] if gain else [value]))
    return CommandSteps(names, tuple(times), tuple(values))


def make_law_plan(
    vehicle: Vehicle,
    start: Floats,
    timing: Timing,
    law: Law,
    steps: CommandSteps,
    *,
    heading: float,
) -> FlightPlan:
    """Return a plan with the commanded course at the initial speed, without a mission."""
    time = np.arange(timing.ticks + 1, dtype=np.float64) * timing.tick
    speed = float(np.linalg.norm(start[s.U : s.W + 1]))
    commands = steps.columns(time)
    course = (
        commands[:, steps.names.index("baseChiCmd")]
        if "baseChiCmd" in steps.names
        else np.full_like(time, heading)
    )
    reference = np.zeros((time.size, len(REFERENCE)))
    reference[:, ref.TIME], reference[:, ref.SPEED], reference[:, ref.HEADING] = time, speed, course
    for column, way in ((ref.NORTH, np.cos(course)), (ref.EAST, np.sin(course))):
        reference[1:, column] = np.cumsum(0.5 * (way[1:] + way[:-1])) * speed * timing.tick
    plan = make_replay_plan(vehicle, ELLIPSOID, start, np.zeros((time.size, 4)), timing)
    return replace(
        plan,
        controller=law.source.hash[:8],
        law="python",
        reference=reference,
        gains=commands,
        gain_names=np.array(steps.column_names(), dtype=np.str_),
        source_hash=law.source.hash,
        source=law.source,
    )
