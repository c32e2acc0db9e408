"""The F-16's check-cases 11 to 16 of NASA/TM-2015-218675: trims, and its own autopilot at steps and circles."""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.control import columns as ref
from abhv_mc.control.columns import REFERENCE
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.plan import FlightPlan, Timing
from abhv_mc.flight.prepare import local_frame_rate
from abhv_mc.numerics.quaternion import from_euler, rotate_to_body
from abhv_mc.plant import state as s
from abhv_mc.plant.trim import FlightPoint, trim
from abhv_mc.shipped import shipped_configs
from abhv_mc.user_code.law_interface import Measured
from abhv_mc.user_code.settings import CommandSteps
from abhv_mc.user_code.source import Law, load_law, read_source
from abhv_mc.user_code.vehicle_functions import load_vehicle
from abhv_mc.vehicle.model import Vehicle
from abhv_mc.verification.nesc_cases import ELLIPSOID, FOOT
from abhv_mc.verification.replay import make_replay_plan, replay
from abhv_mc.world.atmosphere import atmosphere

RATE = 500.0  # Hz of the autopilot, which in the cases is continuous
_DEG = math.pi / 180.0
_KNOT = 1852.0 / 3600.0
_TRIM_STEP = 1e-3  # s, of the accelerations that the trim makes zero
_FULL_STICK = -25.0 * _DEG  # elevator of the whole stick, aft


@dataclass(frozen=True)
class AircraftCase:
    """One case: SI and radians; ``steps`` are what a command gains from a time (s) on."""

    altitude: float = 10_013.0 * FOOT
    velocity: tuple[float, float] = (400.0 * FOOT, 400.0 * FOOT)  # north, east
    latitude: float = 36.01916667 * _DEG
    longitude: float = -75.67444444 * _DEG
    law: str = "f16_control"
    engaged: bool = True  # whether stick and throttle are trimmed with the law engaged as the case has it
    commands: Mapping[str, float] = field(default_factory=dict)
    steps: Mapping[str, tuple[float, float]] = field(default_factory=dict)


_AUTOPILOT = {"sasOn": 1.0, "apOn": 1.0, "latOffset_measured": 0.0}
F16_CASES: dict[str, AircraftCase] = {
    "11": AircraftCase(),
    "12": AircraftCase(altitude=30_013.0 * FOOT, velocity=(2000.0 * FOOT * math.sqrt(0.5),) * 2),
    "13p1": AircraftCase(commands=_AUTOPILOT, steps={"altCmd": (5.0, 100.0 * FOOT)}),
    "13p2": AircraftCase(commands=_AUTOPILOT, steps={"keasCmd": (5.0, -5.0 * _KNOT)}),
    "13p3": AircraftCase(commands=_AUTOPILOT, steps={"baseChiCmd": (15.0, 15.0 * _DEG)}),
    "13p4": AircraftCase(
        commands={**_AUTOPILOT, "latOffset_measured": 1.0}, steps={"latOffset": (20.0, -2000.0 * FOOT)}
    ),
    "15": AircraftCase(
        altitude=10_000.0 * FOOT,
        velocity=(0.0, 563.643 * FOOT),
        latitude=89.95 * _DEG,
        longitude=-45.0 * _DEG,
        law="f16_gnc",
        engaged=False,
        commands={**_AUTOPILOT, "circlePoleSW": 1.0},
    ),
    "16": AircraftCase(
        altitude=10_000.0 * FOOT,
        velocity=(563.643 * FOOT, 0.0),
        latitude=0.0,
        longitude=-179.95 * _DEG,
        law="f16_gnc",
        engaged=False,
        commands={**_AUTOPILOT, "circlePoleSW": 0.0},
    ),
}


def fly_aircraft(name: str, duration: float) -> Floats:
    """States ``[tick, state]`` of a case, ``RATE`` a second, by the product's plant and the imported law."""
    case = F16_CASES[name]
    folder = shipped_configs() / "vehicle"
    vehicle = load_vehicle(folder / "f16.yaml")
    start = solve_start(vehicle, case)
    law = _read_law(folder / "f16" / f"{case.law}.py")
    timing = Timing(1.0 / RATE, 1, math.ceil(duration * RATE - 1e-6))
    steps = make_steps(law, case, start)
    plan = make_law_plan(vehicle, start, timing, law, steps, heading_of(case))
    return fly(plan, nominal_parameters(), record_every=1, keep_states=True).states[0]


@functools.cache
def _read_law(path: Path) -> Law:
    return load_law(read_source(path))


def heading_of(case: AircraftCase) -> float:
    """Of the velocity at the start, rad."""
    return math.atan2(case.velocity[1], case.velocity[0])


def solve_start(vehicle: Vehicle, case: AircraftCase) -> Floats:
    """The trimmed state: angle of attack, elevator and throttle without acceleration along, across and in pitch.

    The plant itself is asked for its accelerations, the local frame's rotation in them.
    """
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
        held = np.tile([0.0, 0.0, *controls[1:]], (2, 1))
        plan = make_replay_plan(vehicle, ELLIPSOID, state(controls), held, Timing(_TRIM_STEP, 1, 1))
        first, second = replay(plan)
        return (second - first)[[s.U, s.W, s.PITCH_RATE]] / _TRIM_STEP

    solution = root(accelerations, [near.angle_of_attack, near.elevator, near.equivalence_ratio], tol=1e-12)
    return state(solution.x)


def make_steps(law: Law, case: AircraftCase, start: Floats) -> CommandSteps:
    """What the law is commanded: course and airspeed of the start, the case's steps, and solved stick and throttle.

    With the law engaged they take up that the law's own design point is not quite this trim: it does not move the
    elevator at the start of the published cases 13, and moves it by a degree at that of the cases 15 and 16.
    """
    speed = math.hypot(*case.velocity)
    equivalent = speed * math.sqrt(atmosphere(case.altitude)[0] / atmosphere(0.0)[0])
    alpha, heading = math.atan2(start[s.W], start[s.U]), heading_of(case)
    given = {"keasCmd": equivalent, "altCmd": case.altitude, "baseChiCmd": heading, **case.commands}
    given |= {"throttleTrim": float(start[s.ETA]), "longStkTrim": float(start[s.ELEVATOR]) / _FULL_STICK}
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
    asked = law.function(Measured(**seen), law.commands(**{name: given.get(name, 0.0) for name in names}))
    if case.engaged:
        given["longStkTrim"] += (float(start[s.ELEVATOR]) - asked.elevator) / _FULL_STICK
        given["throttleTrim"] += float(start[s.ETA]) - asked.throttle
    times, values = [], []
    for name in names:
        value = given.get(name, 0.0)
        at, gain = case.steps.get(name, (0.0, 0.0))
        times.append(np.array([0.0, at] if gain else [0.0]))
        values.append(np.array([value, value + gain] if gain else [value]))
    return CommandSteps(names, tuple(times), tuple(values))


def make_law_plan(
    vehicle: Vehicle, start: Floats, timing: Timing, law: Law, steps: CommandSteps, heading: float
) -> FlightPlan:
    """A plan that flies a law without a mission: its reference is the commanded course at the speed of the start."""
    time = np.arange(timing.ticks + 1, dtype=np.float64) * timing.tick
    speed = float(np.linalg.norm(start[s.U : s.W + 1]))
    commands = steps.columns(time)
    course = (
        commands[:, steps.names.index("baseChiCmd")] if "baseChiCmd" in steps.names else np.full_like(time, heading)
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
