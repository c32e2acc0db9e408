"""Arguments and results of custom code: named tuples of floats in SI units and radians."""

from collections import namedtuple
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from abhv_mc_vehicle.kernel.laws.columns import REFERENCE

NOT_GIVEN = float("inf")  # marks an optional value that a control law or filter omits


class Command(NamedTuple):
    """Command returned by a control law at one tick.

    The engine is commanded by its equivalence ratio or its throttle; by default, the minimum is
    commanded. Metrics and figures compare the flight with the commanded flight-path angle, angle of
    attack and bank; omitted values default to the reference.
    """

    aileron: float  # rad
    rudder: float
    elevator: float
    equivalence_ratio: float = NOT_GIVEN
    flight_path_angle: float = NOT_GIVEN  # rad
    angle_of_attack: float = NOT_GIVEN
    bank: float = NOT_GIVEN
    throttle: float = NOT_GIVEN
    effectors: Any = ()  # deflections by effector name, which bypass the control mix, rad


COMMAND_FIELDS = Command._fields[:-2]  # outputs of laws in C and FMUs
# Command of a law that does not command effectors directly.
MixedCommand = NamedTuple("MixedCommand", [(name, float) for name in Command._fields[:-1]])  # type: ignore[misc]


class Measured(NamedTuple):
    """Quantities measured by the sensors."""

    altitude: float  # m
    speed: float  # m/s
    flight_path_angle: float  # rad
    heading: float
    angle_of_attack: float
    sideslip: float
    bank: float
    roll_rate: float  # rad/s
    pitch_rate: float
    yaw_rate: float
    airspeed: float  # m/s
    mach: float
    load_factor: float  # magnitude of the specific force, g
    pitch: float  # Euler angles relative to north-east-down, rad
    roll: float
    yaw: float
    latitude: float
    longitude: float
    north: float  # integral of the northward Earth-relative velocity, m
    east: float
    equivalent_airspeed: float  # airspeed referred to the density at sea level, m/s
    cross_track: float  # deviation to the left of the reference heading, m
    acceleration_x: float  # specific force at the centre of gravity, body axes, m/s2
    acceleration_y: float
    acceleration_z: float


Reference = NamedTuple("Reference", [(name, float) for name in REFERENCE])  # type: ignore[misc]
Reference.__doc__ = (
    """Reference of the mission and nominal controls at one control tick, SI and radians."""
)


class Moment(NamedTuple):
    """Moment about the centre of gravity in body axes, N m, or its derivative, N m/rad."""

    roll: float
    pitch: float
    yaw: float


class Inertia(NamedTuple):
    """Inertia matrix, kg m2; ``xz`` is the element in row 1, column 3."""

    xx: float
    yy: float
    zz: float
    xz: float


class LastCommand(NamedTuple):
    """Command of the last tick, after clipping to the vehicle's limits."""

    aileron: float  # rad
    rudder: float
    elevator: float
    equivalence_ratio: float


class Onboard(NamedTuple):
    """Nominal vehicle at the measured state and the last command."""

    mach: float
    density: float  # kg/m3
    dynamic_pressure: float  # Pa
    moment: Moment
    moment_by_aileron: Moment
    moment_by_rudder: Moment
    moment_by_elevator: Moment
    lift: float  # normal to the velocity, N
    drag: float
    thrust: float
    lift_by_angle_of_attack: float  # without the contribution of thrust, N/rad
    drag_by_angle_of_attack: float
    thrust_by_angle_of_attack: float
    lift_by_equivalence_ratio: float  # N
    drag_by_equivalence_ratio: float
    thrust_by_equivalence_ratio: float
    inertia: Inertia
    last: LastCommand


def nest(
    kind: Any,
    numbers: Iterator[Any],
    make: Callable[[Any, list[Any]], Any] = lambda kind, values: kind(*values),
) -> Any:
    """Construct a nested named tuple from an iterator of numbers.

    ``make`` constructs each tuple from its class and its values.
    """
    hints = kind.__annotations__.values()
    return make(
        kind,
        [
            nest(hint, numbers, make) if hasattr(hint, "_fields") else next(numbers)
            for hint in hints
        ],
    )


def onboard_fields(kind: Any = Onboard) -> list[str]:
    """Return the flattened field names in order, such as 'mach' and 'moment.roll'."""
    return [
        f"{name}.{inner}" if inner else name
        for name, hint in kind.__annotations__.items()
        for inner in (onboard_fields(hint) if hasattr(hint, "_fields") else [""])
    ]


class Air(NamedTuple):
    """Flow conditions passed to the aerodynamics and engine functions of a vehicle."""

    altitude: float  # m
    mach: float
    density: float  # kg/m3
    pressure: float  # Pa
    sound_speed: float  # m/s
    dynamic_pressure: float  # Pa
    airspeed: float  # m/s
    angle_of_attack: float  # rad
    sideslip: float


class Rates(NamedTuple):
    """Dimensionless body rates relative to the air: p b / (2 V), q c / (2 V), r b / (2 V)."""

    roll_rate: float
    pitch_rate: float
    yaw_rate: float


class Coefficients(NamedTuple):
    """Result of an aerodynamics function: force and moment coefficients.

    Moments are about the reference point. The force coefficients depend on the frame: they are CX,
    CY and CZ in ``body``, CL, CD and CY (along body y) in ``stability``, and CL, CD and CC
    (positive to the right) in ``wind``.
    """

    CX: float = 0.0
    CY: float = 0.0
    CZ: float = 0.0
    CL: float = 0.0
    CD: float = 0.0
    CC: float = 0.0
    Cl: float = 0.0
    Cm: float = 0.0
    Cn: float = 0.0


class Thrust(NamedTuple):
    """Result of an engine function, in body axes at the moment reference."""

    force_x: float  # N
    force_y: float = 0.0
    force_z: float = 0.0
    fuel_flow: float = 0.0  # kg/s
    moment_x: float = 0.0  # N m
    moment_y: float = 0.0
    moment_z: float = 0.0


class Motion(NamedTuple):
    """Motion of the vehicle in body axes, passed to custom dynamics.

    The accelerations are due to all loads except those of the custom dynamics: aerodynamics, thrust
    and, for linear accelerations, gravity. The specific force is ``acceleration`` minus
    ``gravity``.
    """

    u: float  # velocity relative to the Earth, m/s
    v: float
    w: float
    q0: float  # attitude quaternion, body to north-east-down
    q1: float
    q2: float
    q3: float
    roll_rate: float  # rad/s
    pitch_rate: float
    yaw_rate: float
    mass: float  # kg
    acceleration_x: float  # acceleration of the centre of gravity, m/s2
    acceleration_y: float
    acceleration_z: float
    roll_acceleration: float  # rad/s2
    pitch_acceleration: float
    yaw_acceleration: float
    gravity_x: float  # m/s2
    gravity_y: float
    gravity_z: float


_N_MEASURED = len(Measured._fields)
Sensed = namedtuple("Sensed", Measured._fields, defaults=[*_N_MEASURED * [0.0]])  # type: ignore[misc]
Sensed.__doc__ = (
    """Contributions of custom states to the measurements, in the units of the measurements."""
)


class Effect(NamedTuple):
    """Result of custom dynamics: time derivatives of the states, and loads.

    Rates follow the order of the states. Force (N) and moment (N m) are in body axes.
    """

    rates: Any
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sensed: Any = Sensed()


Filtered = namedtuple("Filtered", Measured._fields, defaults=[*_N_MEASURED * [NOT_GIVEN]])  # type: ignore[misc]
Filtered.__doc__ = """Result of a measurement filter; omitted fields keep the measured values."""
FILTER_ARGUMENTS = ("measured", "reference", "memory", "settings", "time", "dt")

# Classes of the arguments that abhv-mc supplies.
GIVEN = {"measured": Measured, "reference": Reference, "onboard": Onboard}
CLASSES = {"memory": "Memory", "settings": "Settings", "commands": "Commands", "gains": "design"}
ARGUMENTS = (
    "measured",
    "reference",
    "memory",
    "settings",
    "commands",
    "gains",
    "onboard",
    "time",
    "dt",
)

_UNITS = {  # SI units of measurements, reference and commands; other names are dimensionless
    "m": ("altitude", "north", "east", "radius", "cross_track"),
    "m/s": ("speed", "altitude_rate", "sound_speed", "airspeed", "equivalent_airspeed"),
    "m/s2": ("speed_rate", "gravity", "acceleration_x", "acceleration_y", "acceleration_z"),
    "s": ("time",),
    "kg": ("mass",),
    "kg/m3": ("density",),
    "rad/s": ("roll_rate", "pitch_rate", "yaw_rate", "heading_rate"),
    "rad": (
        "flight_path_angle",
        "heading",
        "angle_of_attack",
        "sideslip",
        "bank",
        "pitch",
        "roll",
        "yaw",
        "latitude",
        "longitude",
        "aileron",
        "rudder",
        "elevator",
    ),
}


def find_unit(name: str) -> str | None:
    """Return the SI unit of an argument or command, such as measured.altitude.

    The unit is None for gains and onboard quantities.
    """
    group, _, field = name.rpartition(".")
    if group.startswith(("gains", "onboard")) or not field:
        return None
    if group == "effectors":
        return "rad"
    return next((unit for unit, names in _UNITS.items() if field in names), "-")
