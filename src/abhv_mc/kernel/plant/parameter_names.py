"""Names of all that a campaign may disperse, in the order of a flight's parameters ``[parameter, flight]``.

What each is stands in :mod:`abhv_mc.plant.parameters`. A new one goes to the end, in no order of ideas: the dimension
of a Sobol or Halton sequence is its place here, which later ones must not move. So what belongs together may stand in
several places; the kernel finds each block by the name of its first.
"""

import math

from abhv_mc.kernel.plant.vehicle import COEFFICIENTS, MAX_EFFECTORS, MAX_ENGINES

NEVER = math.inf  # time of a failure that does not happen
DENSITY_KNOTS_KM = (10, 15, 20, 25, 30, 35, 40)

# What may fail: the three axis deflections, effectors and engines by their place in the vehicle's file, sensors.
AXES = ("aileron", "rudder", "elevator")
EFFECTORS = tuple(f"effector_{i}" for i in range(MAX_EFFECTORS))
ENGINES = tuple(f"engine_{i}" for i in range(MAX_ENGINES))
SENSORS = (
    *("altitude", "speed", "flight_path_angle", "heading", "angle_of_attack", "sideslip", "bank"),
    *("roll_rate", "pitch_rate", "yaw_rate"),
)
# What user laws may measure besides; the places of their errors came later.
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
ALL_SENSORS = (*SENSORS, *MORE_SENSORS)
ANGLES_OF_PLACE = (
    "flight_path_angle",
    "heading",
    "bank",
    "pitch",
    "roll",
    "yaw",
    "latitude",
    "longitude",
)
SCALED_SENSORS = tuple(name for name in ALL_SENSORS if name not in ANGLES_OF_PLACE)
SENSOR_NOISES = tuple(f"sensor.{name}_noise" for name in ALL_SENSORS)
_RATES = ("roll_rate", "pitch_rate", "yaw_rate")
_GUST_AXES = ("forward", "right", "down")
_FIRST = (*AXES, *EFFECTORS[:4])  # whose places came first
_MORE = EFFECTORS[4:]


def _each(first: tuple[str, ...], then: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"failure.{name}.{what}" for name in first for what in then)


_TIMES, _HOW = ("stuck_time", "loss_time", "slow_time"), ("stuck_at", "effectiveness", "rate_limit")

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
    # Of failures first all times, so that one search finds whether any of them is used.
    *_each(_FIRST, _TIMES),
    "failure.engine.time",
    *(f"failure.sensor.{name}.time" for name in SENSORS),
    *_each(_FIRST, _HOW),
    *_each(("engine",), ("duration", "thrust", "drag_increment", "pitching_moment_increment")),
    *(f"failure.sensor.{name}.bias" for name in SENSORS),
    *(f"wind.turbulence_{axis}" for axis in _GUST_AXES),
    *(f"wind.turbulence_length_{axis}" for axis in _GUST_AXES),
    "wind.turbulence_rotary",
    *_each(_MORE, _TIMES),
    *_each(ENGINES, ("time",)),
    *_each(_MORE, _HOW),
    *_each(ENGINES, ("duration",)),
    *_each(ENGINES, ("thrust",)),
    *(f"control.{name}_effectiveness" for name in EFFECTORS),
    *(f"sensor.{name}_bias" for name in MORE_SENSORS),
    *SENSOR_NOISES[len(SENSORS) :],
    *(f"sensor.{name}_lag" for name in ALL_SENSORS),
    *(f"sensor.{name}_interval" for name in ALL_SENSORS),
    *(f"sensor.{name}_scale" for name in SCALED_SENSORS),
    *(f"{of}.{slack}" for of in ("actuator", "engine") for slack in ("dead_zone", "backlash")),
    *("thrust.inclination", "thrust.azimuth"),
    "atmosphere.temperature",
)
FAILURE_TIMES = tuple(
    name for name in PARAMETER_NAMES if name.startswith("failure.") and name.endswith("time")
)
PARAMETER_INDEX: dict[str, int] = {name: i for i, name in enumerate(PARAMETER_NAMES)}
