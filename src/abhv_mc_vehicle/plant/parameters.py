"""Dispersible parameters: units, nominal values and descriptions.

To add a parameter, append its name in :mod:`abhv_mc_vehicle.kernel.plant.vehicle` (which
determines the order), add a line to the table below and use it in the plant. A parameter at its
nominal value has no effect.
"""

from abhv_mc.flights.parameters import ONE, Parameter, Parameters
from abhv_mc_vehicle.kernel.plant.vehicle import (
    ACCELERATIONS,
    ALL_SENSORS,
    AXES,
    COEFFICIENTS,
    DENSITY_KNOTS_KM,
    EFFECTORS,
    ENGINES,
    NEVER,
    PARAMETER_NAMES,
    SCALED_SENSORS,
    SENSOR_NOISES,
    SENSORS,
)


def _factor(name: str, doc: str) -> Parameter:
    return Parameter(name, "-", 1.0, doc)


def _error(name: str, unit: str, doc: str) -> Parameter:
    return Parameter(name, unit, 0.0, doc)


_COEFFICIENTS = {name: f"{name.replace('_', '-')} coefficient" for name in COEFFICIENTS}
_DERIVATIVES = {
    "sideslip": "sideslip",
    "roll_rate": "roll rate (damping or cross derivative)",
    "pitch_rate": "pitch rate",
    "yaw_rate": "yaw rate (damping or cross derivative)",
    **{name: name for name in AXES},
}
_UNITS = {
    **dict.fromkeys(("altitude", "north", "east", "cross_track"), "m"),
    **dict.fromkeys(("speed", "airspeed", "equivalent_airspeed"), "m/s"),
    **dict.fromkeys(("mach", "load_factor"), "-"),  # The load factor is in g.
    **dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), "rad/s"),
    **dict.fromkeys(ACCELERATIONS, "m/s2"),
}
_SENSED = {name: _UNITS.get(name, "rad") for name in ALL_SENSORS}
_NAVIGATION = {name: _SENSED[name] for name in SENSORS}

_GUST_AXES = {
    "forward": "along body x",
    "right": "along body y",
    "down": "along body z",
}


def _failing(name: str, noun: str) -> tuple[Parameter, ...]:
    """Return the parameters for failures of a surface, axis deflection or effector."""
    return (
        Parameter(f"failure.{name}.stuck_time", "s", NEVER, f"time at which {noun} sticks"),
        Parameter(
            f"failure.{name}.loss_time", "s", NEVER, f"time at which {noun} loses effectiveness"
        ),
        Parameter(f"failure.{name}.slow_time", "s", NEVER, f"time at which {noun} becomes slow"),
        Parameter(
            f"failure.{name}.stuck_at",
            "rad",
            NEVER,
            f"deflection at which {noun} sticks; inf means its current position",
        ),
        _error(
            f"failure.{name}.effectiveness",
            "-",
            f"remaining effectiveness of {noun} after the loss",
        ),
        Parameter(
            f"failure.{name}.rate_limit",
            "-",
            0.1,
            f"factor on the rate limit of {noun} after it becomes slow",
        ),
    )


def _failing_engine(name: str, noun: str) -> tuple[Parameter, ...]:
    return (
        Parameter(f"failure.{name}.time", "s", NEVER, f"time at which {noun} fails"),
        Parameter(
            f"failure.{name}.duration",
            "s",
            NEVER,
            f"duration of the failure of {noun}; inf if permanent",
        ),
        _error(f"failure.{name}.thrust", "-", f"factor on the thrust of {noun} after its failure"),
    )


def _failing_sensor(name: str, unit: str) -> tuple[Parameter, ...]:
    noun = name.replace("_", " ")
    return (
        Parameter(
            f"failure.sensor.{name}.time", "s", NEVER, f"time at which the {noun} sensor fails"
        ),
        _error(
            f"failure.sensor.{name}.bias",
            unit,
            f"bias of the measured {noun} after the failure; 0 freezes the value",
        ),
    )


_TABLE = (
    _factor(ONE, "constant factor on terms without a parameter (not dispersible)"),
    _factor("atmosphere.density", "air density at every altitude"),
    _error(
        "atmosphere.temperature",
        "K",
        "air temperature at every altitude, at unchanged pressure",
    ),
    _error(
        "atmosphere.uniform_temperature_offset",
        "K",
        "uniform offset of the air temperature in a column with the standard sea-level pressure",
    ),
    Parameter(
        "atmosphere.member",
        "-",
        0.0,
        "member of the mission's ensemble of atmospheres, counted from 1; 0: nominal air",
        is_category=True,
    ),
    _error("wind.north", "m/s", "steady wind blowing towards the north"),
    _error("wind.east", "m/s", "steady wind blowing towards the east"),
    _error("wind.shear_north", "1/s", "change of the northward wind per metre of altitude"),
    _error("wind.shear_east", "1/s", "change of the eastward wind per metre of altitude"),
    *(_factor(f"aero.{name}", f"whole {text}") for name, text in _COEFFICIENTS.items()),
    *(
        _error(f"aero.{x}.increment", "-", f"increment of the {_COEFFICIENTS[x]}")
        for x in ("lift", "drag", "pitching_moment")
    ),
    *(
        _factor(f"aero.{name}.{variable}", f"part of the {text} that is proportional to {noun}")
        for name, text in _COEFFICIENTS.items()
        for variable, noun in _DERIVATIVES.items()
    ),
    *(
        _factor(f"control.{name}_effectiveness", f"aerodynamic effectiveness of the {name}")
        for name in AXES
    ),
    *(
        _factor(
            f"control.{name}_effectiveness",
            f"aerodynamic effectiveness of the vehicle's effector {i}",
        )
        for i, name in enumerate(EFFECTORS)
    ),
    _factor("propulsion.thrust", "thrust at unchanged fuel flow"),
    _factor(
        "propulsion.specific_impulse", "specific impulse at unchanged thrust (changes fuel flow)"
    ),
    _error("thrust.inclination", "rad", "upward rotation of the thrust about its point of action"),
    _error(
        "thrust.azimuth", "rad", "rotation of the thrust to the right about its point of action"
    ),
    _factor("mass.total", "initial mass"),
    *(
        _factor(f"mass.inertia_{axis}{axis}", f"moment of inertia about body {axis}")
        for axis in "xyz"
    ),
    _factor("mass.inertia_13", "product of inertia (matrix element 13)"),
    _error("mass.center_of_gravity_x", "m", "forward shift of the centre of gravity"),
    _error("mass.center_of_gravity_y", "m", "rightward shift of the centre of gravity"),
    _error("mass.center_of_gravity_z", "m", "downward shift of the centre of gravity"),
    _factor("actuator.bandwidth", "natural frequency of the three surface actuators"),
    _factor("actuator.damping", "damping ratio of the three surface actuators"),
    _factor("actuator.deflection_limit", "deflection limit of the three surfaces"),
    _factor("actuator.rate_limit", "rate limit of the three surfaces"),
    _factor("engine.bandwidth", "natural frequency of the engine"),
    _factor("engine.damping", "damping ratio of the engine"),
    _factor("engine.rate_limit", "rate limit of the throttle (equivalence ratio)"),
    *(
        _factor(f"{group}.{name}", f"{noun} of {of}")
        for group, of in (("actuator", "the surface actuators"), ("engine", "the throttle"))
        for name, noun in (("dead_zone", "dead zone"), ("backlash", "backlash"))
    ),
    *(
        _error(f"initial.{name}", unit, f"initial error of the {name.replace('_', ' ')}")
        for name, unit in _NAVIGATION.items()
    ),
    *(
        _error(
            f"sensor.{name}_{error}",
            unit_of or unit,
            f"{noun} the measured {name.replace('_', ' ')}",
        )
        for name, unit in _SENSED.items()
        for error, unit_of, noun in (
            ("bias", "", "constant error of"),
            ("noise", "", "rms of the white noise on"),
            ("lag", "s", "time constant of the first-order lag of"),
            ("interval", "s", "sampling interval, in whole control periods, of"),
        )
    ),
    *(
        _factor(f"sensor.{name}_scale", f"the measured {name.replace('_', ' ')}")
        for name in SCALED_SENSORS
    ),
    _factor("engine.equivalence_ratio_limit", "upper limit of the throttle (equivalence ratio)"),
    *(
        _factor(
            f"atmosphere.density_at_{km}km",
            f"air density at {km} km, linear in altitude between the profile's knots",
        )
        for km in DENSITY_KNOTS_KM
    ),
    _error("wind.gust_north", "m/s", "1-cosine gust: wind change towards the north"),
    _error("wind.gust_east", "m/s", "1-cosine gust: wind change towards the east"),
    _error("wind.gust_down", "m/s", "1-cosine gust: wind change downwards"),
    Parameter("wind.gust_start", "s", 0.0, "1-cosine gust: time at which the gust begins"),
    Parameter("wind.gust_length", "m", 1000.0, "1-cosine gust: distance from zero to full wind"),
    _error("wind.turbulence", "m/s", "Dryden turbulence: rms of each of the three components"),
    Parameter(
        "wind.turbulence_length",
        "m",
        533.4,
        "Dryden turbulence: scale length (1750 ft at medium and high altitudes)",
    ),
    Parameter(
        "wind.turbulence_seed",
        "-",
        0.5,
        "uniformly distributed number from 0 to 1 that selects the turbulence of a flight",
        seed=True,
        noises=("wind.turbulence",),
    ),
    Parameter(
        "sensor.noise_seed",
        "-",
        0.5,
        "uniformly distributed number from 0 to 1 that selects the sensor noise of a flight",
        seed=True,
        noises=SENSOR_NOISES,
    ),
    _error(
        "sensor.delay",
        "s",
        "delay of all measurements, in whole control periods, at most 25 of them",
    ),
    *(entry for name in AXES for entry in _failing(name, f"the {name}")),
    *(
        entry
        for i, name in enumerate(EFFECTORS)
        for entry in _failing(name, f"the vehicle's effector {i}")
    ),
    *(
        entry
        for i, name in enumerate(ENGINES)
        for entry in _failing_engine(name, f"the vehicle's engine {i}")
    ),
    *(entry for name, unit in _NAVIGATION.items() for entry in _failing_sensor(name, unit)),
    Parameter("failure.engine.time", "s", NEVER, "time at which the engine fails"),
    Parameter(
        "failure.engine.duration", "s", NEVER, "duration of the engine failure; inf if permanent"
    ),
    _error(
        "failure.engine.thrust",
        "-",
        "factor on thrust and fuel flow of the failed engine; 0 is a flame-out",
    ),
    *(
        _error(
            f"failure.engine.{name}_increment",
            "-",
            f"change of the {_COEFFICIENTS[name]} during an engine failure",
        )
        for name in ("drag", "pitching_moment")
    ),
    *(
        _factor(
            f"wind.turbulence_{axis}", f"Dryden turbulence: rms {noun} divided by wind.turbulence"
        )
        for axis, noun in _GUST_AXES.items()
    ),
    *(
        _factor(
            f"wind.turbulence_length_{axis}",
            f"Dryden turbulence: scale length {noun} divided by wind.turbulence_length",
        )
        for axis, noun in _GUST_AXES.items()
    ),
    _error(
        "wind.turbulence_rotary",
        "-",
        "Dryden turbulence: 1 switches the rotary gusts p, q and r on, 0 off",
    ),
)

_ENTRIES = {entry.name: entry for entry in _TABLE}
PARAMETERS = tuple(_ENTRIES.pop(name) for name in PARAMETER_NAMES)
assert not _ENTRIES, f"parameters that the kernel does not know: {', '.join(_ENTRIES)}"  # noqa: S101


OURS = Parameters(PARAMETERS)

# Parameters that can make an angle oscillate even if there is no limit cycle.
DISTURBANCES = (
    "wind.gust_north",
    "wind.gust_east",
    "wind.gust_down",
    "wind.turbulence",
    *SENSOR_NOISES,
)
