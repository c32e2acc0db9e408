"""S-119 signals of a vehicle: names and their synonyms, signs and units."""

import re
from collections.abc import Iterable

from abhv_mc_daveml.graph import Model, Variable

# Unit and names of each quantity; names are compared by letters and digits, ignoring case.
_QUANTITIES: dict[str, tuple[str, ...]] = {
    # signals of air and motion
    "airspeed": ("m/s", "trueAirspeed", "velocityTrue", "airspeed"),
    "equivalent_airspeed": ("m/s", "equivalentAirspeed"),
    "mach": ("-", "mach", "machNumber"),
    "altitude": ("m", "altitudeMsl", "altitude", "geometricAltitude", "altitudeGeometric",
                 "heightOfCmWrtMsl"),
    "density": ("kg/m3", "airDensity", "density", "ambientDensity"),
    "pressure": ("Pa", "ambientPressure", "staticPressure"),
    "temperature": ("K", "ambientTemperature", "staticTemperature", "airTemperature"),
    "sound_speed": ("m/s", "speedOfSound"),
    "dynamic_pressure": ("Pa", "dynamicPressure"),
    "angle_of_attack": ("rad", "angleOfAttack", "alpha"),
    "sideslip": ("rad", "angleOfSideslip", "sideslipAngle", "beta"),
    "roll_rate": ("rad/s", "bodyAngularRate_Roll", "bodyAngularRateWrtEi_Roll", "rollRate"),
    "pitch_rate": ("rad/s", "bodyAngularRate_Pitch", "bodyAngularRateWrtEi_Pitch", "pitchRate"),
    "yaw_rate": ("rad/s", "bodyAngularRate_Yaw", "bodyAngularRateWrtEi_Yaw", "yawRate"),
    "roll": ("rad", "eulerAngle_Roll"),
    "pitch": ("rad", "eulerAngle_Pitch"),
    "yaw": ("rad", "eulerAngle_Yaw"),
    "cross_track": ("m", "lateralDeviationError"),
    "latitude": ("rad", "geLatitude", "geodeticLatitude", "latitude", "positionGeodetic_Latitude"),
    "longitude": ("rad", "geLongitude", "geodeticLongitude", "longitude",
                  "positionGeodetic_Longitude"),
    # signals of control surfaces and engine
    "aileron": ("rad", "aileronDeflection"),
    "rudder": ("rad", "rudderDeflection"),
    "elevator": ("rad", "elevatorDeflection", "stabilatorDeflection", "horizontalTailDeflection"),
    "throttle": ("-", "powerLeverAngle", "throttlePosition", "thrustLeverAngle"),
    # aerodynamic coefficients
    "CX": ("-", "aeroBodyForceCoefficient_X", "bodyForceCoefficient_X", "axialForceCoefficient_X"),
    "CY": ("-", "aeroBodyForceCoefficient_Y", "bodyForceCoefficient_Y", "sideForceCoefficient"),
    "CZ": ("-", "aeroBodyForceCoefficient_Z", "bodyForceCoefficient_Z"),
    "CL": ("-", "totalCoefficientOfLift", "liftCoefficient", "coefficientOfLift"),
    "CD": ("-", "totalCoefficientOfDrag", "dragCoefficient", "coefficientOfDrag"),
    "Cl": ("-", "aeroBodyMomentCoefficient_Roll", "rollingMomentCoefficient",
           "bodyMomentCoefficient_Roll"),
    "Cm": ("-", "aeroBodyMomentCoefficient_Pitch", "pitchingMomentCoefficient",
           "bodyMomentCoefficient_Pitch"),
    "Cn": ("-", "aeroBodyMomentCoefficient_Yaw", "yawingMomentCoefficient",
           "bodyMomentCoefficient_Yaw"),
    "area": ("m2", "referenceWingArea", "referenceArea"),
    "span": ("m", "referenceWingSpan", "lateralReferenceLength", "referenceSpan"),
    "chord": ("m", "referenceWingChord", "longitudinalReferenceLength", "referenceChord"),
    # signals of the engine output
    "force_x": ("N", "thrustBodyForce_X", "bodyThrustForce_X"),
    "force_y": ("N", "thrustBodyForce_Y", "bodyThrustForce_Y"),
    "force_z": ("N", "thrustBodyForce_Z", "bodyThrustForce_Z"),
    "moment_x": ("N m", "thrustBodyMoment_Roll", "bodyThrustMoment_Roll"),
    "moment_y": ("N m", "thrustBodyMoment_Pitch", "bodyThrustMoment_Pitch"),
    "moment_z": ("N m", "thrustBodyMoment_Yaw", "bodyThrustMoment_Yaw"),
    "fuel_flow": ("kg/s", "massDot", "fuelFlow", "fuelMassFlowRate"),
    # mass properties
    "mass": ("kg", "totalMass", "mass"),
    "inertia_xx": ("kg m2", "bodyMomentOfInertia_Roll"),
    "inertia_yy": ("kg m2", "bodyMomentOfInertia_Pitch"),
    "inertia_zz": ("kg m2", "bodyMomentOfInertia_Yaw"),
    "inertia_zx": ("kg m2", "bodyProductOfInertia_ZX", "bodyProductOfInertia_XZ"),
    "inertia_xy": ("kg m2", "bodyProductOfInertia_XY"),
    "inertia_yz": ("kg m2", "bodyProductOfInertia_YZ"),
    "center_of_gravity_x": ("m", "bodyPositionOfCmWrtMrc_X"),
    "center_of_gravity_y": ("m", "bodyPositionOfCmWrtMrc_Y"),
    "center_of_gravity_z": ("m", "bodyPositionOfCmWrtMrc_Z"),
}  # fmt: skip
SI = {quantity: unit for quantity, (unit, *_) in _QUANTITIES.items()}

# Values of the attribute ``sign`` for the same direction as in abhv-mc and for the opposite one.
_ROLLS = (
    {"rwd", "rightroll", "rightwingdown", "rollsright"},
    {"lwd", "leftroll", "leftwingdown", "rollsleft"},
)
_PITCHES = ({"anu", "noseup", "aircraftnoseup"}, {"and", "nosedown", "aircraftnosedown"})
_YAWS = (
    {"anr", "noseright", "aircraftnoseright", "cwfn"},
    {"anl", "noseleft", "aircraftnoseleft", "ccfn"},
)
_AHEAD = ({"fwd", "forward"}, {"aft", "back"})
_RIGHT = ({"rt", "right"}, {"lt", "left"})
_DOWN = ({"down", "dwn", "dn"}, {"up"})
_SIGNS = {
    "aileron": _ROLLS,
    "rudder": (
        {"tel", "trailingedgeleft", "anl", "noseleft"},
        {"ter", "trailingedgeright", "anr", "noseright"},
    ),
    "elevator": (
        {"ted", "trailingedgedown", "and", "nosedown"},
        {"teu", "trailingedgeup", "anu", "noseup"},
    ),
    **dict.fromkeys(("roll_rate", "roll", "Cl", "moment_x"), _ROLLS),
    **dict.fromkeys(("angle_of_attack", "pitch_rate", "pitch", "Cm", "moment_y"), _PITCHES),
    **dict.fromkeys(("yaw_rate", "yaw", "Cn", "moment_z"), _YAWS),
    "sideslip": (
        _YAWS[1] | {"rt", "right", "windinrightear"},
        _YAWS[0] | {"lt", "left", "windinleftear"},
    ),
    **dict.fromkeys(("CX", "force_x", "center_of_gravity_x"), _AHEAD),
    **dict.fromkeys(("CY", "force_y", "center_of_gravity_y", "cross_track"), _RIGHT),
    **dict.fromkeys(("CZ", "force_z", "center_of_gravity_z"), _DOWN),
    **dict.fromkeys(("CL", "altitude"), _DOWN[::-1]),
    "CD": _AHEAD[::-1],
    "latitude": ({"n", "north"}, {"s", "south"}),
    "longitude": ({"e", "east"}, {"w", "west"}),
}
_SURFACES = ("aileron", "rudder", "elevator")  # S-119 defines no sign for these names.


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


_QUANTITY_OF = {
    _plain(name): quantity for quantity, (_, *names) in _QUANTITIES.items() for name in names
}


def quantity_of(variable: Variable) -> str | None:
    """Return the quantity of a variable by name or, failing that, by identifier."""
    by_name = _QUANTITY_OF.get(_plain(variable.name))
    return (
        by_name or _QUANTITY_OF.get(_plain(variable.identifier))
        if len(variable.identifier) > 5
        else by_name
    )


def sign_of(quantity: str, variable: Variable) -> int | None:
    """Return +1 for the sign convention of abhv-mc, -1 for the opposite, None if unknown.

    Names in S-119 define the signs of all quantities except deflections; a file may define other
    signs.
    """
    word = _plain(variable.sign)
    if quantity not in _SIGNS or (quantity not in _SURFACES and word in ("", "incr")):
        return 1
    same, other = _SIGNS[quantity]
    return 1 if word in same else -1 if word in other else None


def find_signals(variables: Iterable[Variable]) -> dict[str, Variable]:
    """Return the first variable that represents each quantity, by quantity."""
    signals: dict[str, Variable] = {}
    for variable in variables:
        quantity = quantity_of(variable)
        if quantity is not None:
            signals.setdefault(quantity, variable)
    return signals


def kinds_of(model: Model) -> tuple[str, ...]:
    """Return the kinds to which a model belongs, as determined by its outputs.

    The kinds are aerodynamics, propulsion, inertia and control; the kind atmosphere applies only if
    no other kind does.
    """
    outputs = find_signals(model.outputs)
    markers = {
        "aerodynamics": ("CX", "CZ", "CL", "CD"),
        "propulsion": ("force_x",),
        "inertia": ("mass", "inertia_xx"),
        "control": ("aileron", "rudder", "elevator"),
    }
    kinds = tuple(kind for kind, names in markers.items() if any(name in outputs for name in names))
    air = "density" in outputs or {"pressure", "temperature"} <= outputs.keys()
    return kinds or (("atmosphere",) if air else ())
