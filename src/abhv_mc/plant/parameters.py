"""Every quantity that a campaign may disperse: one line each.

A flight's parameters are one column of an array ``[parameter, flight]`` in this order.
Adding one is a line here and its use in the plant. Nominal values leave the flight unchanged.
"""

import math
from dataclasses import dataclass

from abhv_mc.vehicle.arrays import MAX_EFFECTORS, MAX_ENGINES


@dataclass(frozen=True)
class Parameter:
    """One dispersible quantity."""

    name: str
    unit: str  # SI; "-" for a factor (1.0 = nominal)
    nominal: float
    doc: str


def _factor(name: str, doc: str) -> Parameter:
    return Parameter(name, "-", 1.0, doc)


def _error(name: str, unit: str, doc: str) -> Parameter:
    return Parameter(name, unit, 0.0, doc)


_COEFFICIENTS = {
    "lift": "lift coefficient",
    "drag": "drag coefficient",
    "side_force": "side-force coefficient",
    "rolling_moment": "rolling-moment coefficient",
    "pitching_moment": "pitching-moment coefficient",
    "yawing_moment": "yawing-moment coefficient",
}
_DERIVATIVES = {
    "sideslip": "sideslip",
    "roll_rate": "roll rate (damping or cross derivative)",
    "pitch_rate": "pitch rate",
    "yaw_rate": "yaw rate (damping or cross derivative)",
    "aileron": "aileron",
    "rudder": "rudder",
    "elevator": "elevator",
}
_NAVIGATION = {
    "altitude": "m",
    "speed": "m/s",
    "flight_path_angle": "rad",
    "heading": "rad",
    "angle_of_attack": "rad",
    "sideslip": "rad",
    "bank": "rad",
    "roll_rate": "rad/s",
    "pitch_rate": "rad/s",
    "yaw_rate": "rad/s",
}

_GUST_AXES = {"forward": "along the body", "right": "across it", "down": "down in body axes"}

DENSITY_KNOTS_KM = (10, 15, 20, 25, 30, 35, 40)

NEVER = math.inf  # time of a failure that does not happen
# What may fail: the three axis deflections, and the vehicle's own effectors by their place in its file.
AXES = ("aileron", "rudder", "elevator")
EFFECTORS = tuple(f"effector_{i}" for i in range(MAX_EFFECTORS))
_FIRST_EFFECTORS = EFFECTORS[:4]  # whose places in the table came first
ENGINES = tuple(f"engine_{i}" for i in range(MAX_ENGINES))
SENSORS = tuple(_NAVIGATION)


def _surface_words(name: str) -> str:
    return f"the vehicle's effector {name.split('_')[1]}" if name in EFFECTORS else f"the {name}"


def _surface_times(surfaces: tuple[str, ...]) -> list[Parameter]:
    return [
        Parameter(f"failure.{name}.{kind}_time", "s", NEVER, f"time at which {_surface_words(name)} {text}")
        for name in surfaces
        for kind, text in (("stuck", "sticks"), ("loss", "loses effectiveness"), ("slow", "becomes slow"))
    ]


def _surface_failures(surfaces: tuple[str, ...]) -> list[Parameter]:
    return [
        parameter
        for name in surfaces
        for words in (_surface_words(name),)
        for parameter in (
            Parameter(f"failure.{name}.stuck_at", "rad", NEVER, f"deflection that {words} sticks at; inf: where it is"),
            _error(f"failure.{name}.effectiveness", "-", f"effectiveness of {words} after its loss"),
            Parameter(f"failure.{name}.rate_limit", "-", 0.1, f"factor on the rate limit of {words} once slow"),
        )
    ]


def _failures() -> tuple[Parameter, ...]:
    """Failures at drawn times: first all times, so that one search finds whether any of them is used."""
    surfaces = (*AXES, *_FIRST_EFFECTORS)
    times = _surface_times(surfaces)
    times.append(Parameter("failure.engine.time", "s", NEVER, "time at which the engine fails"))
    times += [
        Parameter(
            f"failure.sensor.{name}.time", "s", NEVER, f"time at which the measured {name.replace('_', ' ')} fails"
        )
        for name in SENSORS
    ]
    how = _surface_failures(surfaces)
    how += [
        Parameter("failure.engine.duration", "s", NEVER, "how long the engine has failed; inf: for good"),
        _error("failure.engine.thrust", "-", "factor on thrust and fuel flow of the failed engine; 0: flame-out"),
        _error("failure.engine.drag_increment", "-", "added to the drag coefficient while the engine has failed"),
        _error(
            "failure.engine.pitching_moment_increment",
            "-",
            "added to the pitching-moment coefficient while the engine has failed",
        ),
    ]
    how += [
        _error(
            f"failure.sensor.{name}.bias",
            unit,
            f"error of the failed measured {name.replace('_', ' ')}; 0: it stays what it was",
        )
        for name, unit in _NAVIGATION.items()
    ]
    return (*times, *how)


def _more_failures() -> tuple[Parameter, ...]:
    """Of further effectors, and of single engines."""
    more = EFFECTORS[len(_FIRST_EFFECTORS) :]
    words = {name: f"the vehicle's engine {name.split('_')[1]}" for name in ENGINES}
    return (
        *_surface_times(more),
        *(Parameter(f"failure.{name}.time", "s", NEVER, f"time at which {words[name]} fails") for name in ENGINES),
        *_surface_failures(more),
        *(
            Parameter(f"failure.{name}.duration", "s", NEVER, f"how long {words[name]} has failed; inf: for good")
            for name in ENGINES
        ),
        *(_error(f"failure.{name}.thrust", "-", f"factor on the thrust of {words[name]} failed") for name in ENGINES),
    )


PARAMETERS: tuple[Parameter, ...] = (
    _factor("one", "not dispersible: the factor of a term that no parameter touches"),
    _factor("atmosphere.density", "air density, at every altitude"),
    _error("wind.north", "m/s", "steady wind blowing towards the north"),
    _error("wind.east", "m/s", "steady wind blowing towards the east"),
    _error("wind.shear_north", "1/s", "change of the northward wind per metre of altitude"),
    _error("wind.shear_east", "1/s", "change of the eastward wind per metre of altitude"),
    *(_factor(f"aero.{name}", f"whole {text}") for name, text in _COEFFICIENTS.items()),
    _error("aero.lift.increment", "-", "added to the lift coefficient"),
    _error("aero.drag.increment", "-", "added to the drag coefficient"),
    _error("aero.pitching_moment.increment", "-", "added to the pitching-moment coefficient"),
    *(
        _factor(f"aero.{name}.{variable}", f"part of the {text} that is proportional to {words}")
        for name, text in _COEFFICIENTS.items()
        for variable, words in _DERIVATIVES.items()
    ),
    _factor("control.aileron_effectiveness", "aileron deflection felt by the aerodynamics"),
    _factor("control.rudder_effectiveness", "rudder deflection felt by the aerodynamics"),
    _factor("control.elevator_effectiveness", "elevator deflection felt by the aerodynamics"),
    _factor("propulsion.thrust", "thrust at the same fuel flow"),
    _factor("propulsion.specific_impulse", "specific impulse at the same thrust (changes the fuel flow)"),
    _factor("mass.total", "mass at the start"),
    _factor("mass.inertia_xx", "moment of inertia about body x"),
    _factor("mass.inertia_yy", "moment of inertia about body y"),
    _factor("mass.inertia_zz", "moment of inertia about body z"),
    _factor("mass.inertia_13", "product of inertia (matrix element 13)"),
    _error("mass.center_of_gravity_x", "m", "centre of gravity moved forward"),
    _error("mass.center_of_gravity_y", "m", "centre of gravity moved right"),
    _error("mass.center_of_gravity_z", "m", "centre of gravity moved down"),
    _factor("actuator.bandwidth", "natural frequency of the three surface actuators"),
    _factor("actuator.damping", "damping ratio of the three surface actuators"),
    _factor("actuator.deflection_limit", "deflection limit of the three surfaces"),
    _factor("actuator.rate_limit", "rate limit of the three surfaces"),
    _factor("engine.bandwidth", "natural frequency of the engine"),
    _factor("engine.damping", "damping ratio of the engine"),
    _factor("engine.rate_limit", "rate limit of the equivalence ratio"),
    *(
        _error(f"initial.{name}", unit, f"error of the {name.replace('_', ' ')} at the start")
        for name, unit in _NAVIGATION.items()
    ),
    *(
        _error(f"sensor.{name}_bias", unit, f"constant error of the measured {name.replace('_', ' ')}")
        for name, unit in _NAVIGATION.items()
    ),
    # New parameters go to the end: the dimension of a Sobol or Halton sequence is the place in this table.
    _factor("engine.equivalence_ratio_limit", "upper limit of the equivalence ratio"),
    *(
        _factor(
            f"atmosphere.density_at_{km}km", f"air density at {km} km, linear in altitude between the profile's knots"
        )
        for km in DENSITY_KNOTS_KM
    ),
    _error("wind.gust_north", "m/s", "1-cosine gust: what the wind gains towards the north"),
    _error("wind.gust_east", "m/s", "1-cosine gust: what the wind gains towards the east"),
    _error("wind.gust_down", "m/s", "1-cosine gust: what the wind gains downwards"),
    Parameter("wind.gust_start", "s", 0.0, "1-cosine gust: time at which the flight enters it"),
    Parameter("wind.gust_length", "m", 1000.0, "1-cosine gust: distance over which it builds up"),
    _error("wind.turbulence", "m/s", "Dryden turbulence: rms of each of the three components"),
    Parameter("wind.turbulence_length", "m", 533.4, "Dryden turbulence: scale length (1750 ft at altitude)"),
    Parameter("wind.turbulence_seed", "-", 0.5, "which turbulence a flight meets, 0..1: draw it uniformly"),
    *(
        _error(f"sensor.{name}_noise", unit, f"rms of the white noise on the measured {name.replace('_', ' ')}")
        for name, unit in _NAVIGATION.items()
    ),
    Parameter("sensor.noise_seed", "-", 0.5, "which sensor noise a flight meets, 0..1: draw it uniformly"),
    _error("sensor.delay", "s", "age of every measurement, in whole control periods, at most 25 of them"),
    *_failures(),
    *(
        _factor(f"wind.turbulence_{axis}", f"Dryden turbulence: rms {words}, of that of wind.turbulence")
        for axis, words in _GUST_AXES.items()
    ),
    *(
        _factor(f"wind.turbulence_length_{axis}", f"Dryden turbulence: scale length {words}, of wind.turbulence_length")
        for axis, words in _GUST_AXES.items()
    ),
    _error("wind.turbulence_rotary", "-", "rotary gusts p, q, r of Dryden turbulence: 1 on, 0 off"),
    *_more_failures(),
)

SENSOR_NOISES = tuple(f"sensor.{name}_noise" for name in _NAVIGATION)
# What swings an angle without a limit cycle.
DISTURBANCES = ("wind.gust_north", "wind.gust_east", "wind.gust_down", "wind.turbulence", *SENSOR_NOISES)

FAILURE_TIMES = tuple(
    parameter.name
    for parameter in PARAMETERS
    if parameter.name.startswith("failure.") and parameter.nominal == NEVER and parameter.name.endswith("time")
)

PARAMETER_INDEX: dict[str, int] = {parameter.name: i for i, parameter in enumerate(PARAMETERS)}
