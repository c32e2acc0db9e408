"""Names of all dispersible parameters, in the order of a flight's parameters.

The parameters are described in :mod:`abhv_mc_vehicle.plant.parameters`. New parameters are
appended, because the position here is the dimension of a Sobol or Halton sequence and must not
change. Related parameters may therefore be in several blocks; the kernel finds each block by the
name of its first parameter.
"""

import math

from abhv_mc_vehicle.kernel.plant.vehicle import COEFFICIENTS, MAX_EFFECTORS, MAX_ENGINES

MEMBER = "atmosphere.member"
NEVER = math.inf  # time of a failure that does not occur
DENSITY_KNOTS_KM = (10, 15, 20, 25, 30, 35, 40)

# Components that may fail: axes, effectors and engines (numbered), and sensors.
AXES = ("aileron", "rudder", "elevator")
EFFECTORS = tuple(f"effector_{i}" for i in range(MAX_EFFECTORS))
ENGINES = tuple(f"engine_{i}" for i in range(MAX_ENGINES))
SENSORS = (
    *("altitude", "speed", "flight_path_angle", "heading", "angle_of_attack", "sideslip", "bank"),
    *("roll_rate", "pitch_rate", "yaw_rate"),
)
# Additional measurements for custom control laws, whose errors are in a separate block.
MORE_SENSORS = (
    *(
        "airspeed",
        "mach",
        "load_factor",
        "pitch",
        "roll",
        "yaw",
        "latitude",
        "longitude",
        "north",
        "east",
    ),
    *("equivalent_airspeed", "cross_track"),
)
ACCELERATIONS = ("acceleration_x", "acceleration_y", "acceleration_z")  # specific force, body axes
_EARLIER_SENSORS = (*SENSORS, *MORE_SENSORS)
ALL_SENSORS = (*_EARLIER_SENSORS, *ACCELERATIONS)
UNSCALED_SENSORS = (
    "flight_path_angle",
    "heading",
    "bank",
    "pitch",
    "roll",
    "yaw",
    "latitude",
    "longitude",
)
SCALED_SENSORS = tuple(name for name in ALL_SENSORS if name not in UNSCALED_SENSORS)
SENSOR_NOISES = tuple(f"sensor.{name}_noise" for name in ALL_SENSORS)
_RATES = ("roll_rate", "pitch_rate", "yaw_rate")
_GUST_AXES = ("forward", "right", "down")
_FIRST = (*AXES, *EFFECTORS[:4])  # components in the first block of failures
_MORE = EFFECTORS[4:]


def _failure_names(first: tuple[str, ...], then: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"failure.{name}.{what}" for name in first for what in then)


_TIMES, _MODES = (
    ("stuck_time", "loss_time", "slow_time"),
    ("stuck_at", "effectiveness", "rate_limit"),
)

PARAMETER_NAMES: tuple[str, ...] = (
    *(
        "one",
        "atmosphere.density",
        "wind.north",
        "wind.east",
        "wind.shear_north",
        "wind.shear_east",
    ),
    *(f"aero.{name}" for name in COEFFICIENTS),
    *(f"aero.{name}.increment" for name in ("lift", "drag", "pitching_moment")),
    *(
        f"aero.{name}.{variable}"
        for name in COEFFICIENTS
        for variable in ("sideslip", *_RATES, *AXES)
    ),
    *(f"control.{name}_effectiveness" for name in AXES),
    *(f"propulsion.{name}" for name in ("thrust", "specific_impulse")),
    *(f"mass.{name}" for name in ("total", "inertia_xx", "inertia_yy", "inertia_zz", "inertia_13")),
    *(f"mass.center_of_gravity_{axis}" for axis in "xyz"),
    *(f"actuator.{name}" for name in ("bandwidth", "damping", "deflection_limit", "rate_limit")),
    *(f"engine.{name}" for name in ("bandwidth", "damping", "rate_limit")),
    *(f"initial.{name}" for name in SENSORS),
    *(f"sensor.{name}_bias" for name in SENSORS),
    "engine.equivalence_ratio_limit",
    *(f"atmosphere.density_at_{km}km" for km in DENSITY_KNOTS_KM),
    *(f"wind.gust_{name}" for name in ("north", "east", "down", "start", "length")),
    *("wind.turbulence", "wind.turbulence_length", "wind.turbulence_seed"),
    *SENSOR_NOISES[: len(SENSORS)],
    *("sensor.noise_seed", "sensor.delay"),
    # All failure times are contiguous, so that one search finds any finite time.
    *_failure_names(_FIRST, _TIMES),
    "failure.engine.time",
    *(f"failure.sensor.{name}.time" for name in SENSORS),
    *_failure_names(_FIRST, _MODES),
    *_failure_names(
        ("engine",), ("duration", "thrust", "drag_increment", "pitching_moment_increment")
    ),
    *(f"failure.sensor.{name}.bias" for name in SENSORS),
    *(f"wind.turbulence_{axis}" for axis in _GUST_AXES),
    *(f"wind.turbulence_length_{axis}" for axis in _GUST_AXES),
    "wind.turbulence_rotary",
    *_failure_names(_MORE, _TIMES),
    *_failure_names(ENGINES, ("time",)),
    *_failure_names(_MORE, _MODES),
    *_failure_names(ENGINES, ("duration",)),
    *_failure_names(ENGINES, ("thrust",)),
    *(f"control.{name}_effectiveness" for name in EFFECTORS),
    *(f"sensor.{name}_bias" for name in MORE_SENSORS),
    *SENSOR_NOISES[len(SENSORS) : len(_EARLIER_SENSORS)],
    *(f"sensor.{name}_lag" for name in _EARLIER_SENSORS),
    *(f"sensor.{name}_interval" for name in _EARLIER_SENSORS),
    *(f"sensor.{name}_scale" for name in SCALED_SENSORS if name not in ACCELERATIONS),
    *(
        f"sensor.{name}_{error}"
        for error in ("bias", "noise", "lag", "interval", "scale")
        for name in ACCELERATIONS
    ),
    *(
        f"{device}.{slack}"
        for device in ("actuator", "engine")
        for slack in ("dead_zone", "backlash")
    ),
    *("thrust.inclination", "thrust.azimuth"),
    *("atmosphere.temperature", "atmosphere.uniform_temperature_offset"),
    MEMBER,
)
FAILURE_TIMES = tuple(
    name for name in PARAMETER_NAMES if name.startswith("failure.") and name.endswith("time")
)
PARAMETER_INDEX: dict[str, int] = {name: i for i, name in enumerate(PARAMETER_NAMES)}
