"""Which S-119 signals carry what a vehicle needs: their names, with the synonyms that are in use, signs and units."""

import re
from collections.abc import Iterable

from abhv_mc.daveml.graph import Model, Variable

# Quantity: names that stand for it, compared without regard to case and to anything but letters and digits.
_SYNONYMS: dict[str, tuple[str, ...]] = {
    # the air and the motion
    "airspeed": ("trueAirspeed", "velocityTrue", "airspeed"),
    "equivalent_airspeed": ("equivalentAirspeed",),
    "mach": ("mach", "machNumber"),
    "altitude": ("altitudeMsl", "altitude", "geometricAltitude", "altitudeGeometric", "heightOfCmWrtMsl"),
    "density": ("airDensity", "density", "ambientDensity"),
    "pressure": ("ambientPressure", "staticPressure"),
    "sound_speed": ("speedOfSound",),
    "dynamic_pressure": ("dynamicPressure",),
    "angle_of_attack": ("angleOfAttack", "alpha"),
    "sideslip": ("angleOfSideslip", "sideslipAngle", "beta"),
    "roll_rate": ("bodyAngularRate_Roll", "bodyAngularRateWrtEi_Roll", "rollRate"),
    "pitch_rate": ("bodyAngularRate_Pitch", "bodyAngularRateWrtEi_Pitch", "pitchRate"),
    "yaw_rate": ("bodyAngularRate_Yaw", "bodyAngularRateWrtEi_Yaw", "yawRate"),
    "roll": ("eulerAngle_Roll",),
    "pitch": ("eulerAngle_Pitch",),
    "yaw": ("eulerAngle_Yaw",),
    "cross_track": ("lateralDeviationError",),
    "latitude": ("geLatitude", "geodeticLatitude", "latitude", "positionGeodetic_Latitude"),
    "longitude": ("geLongitude", "geodeticLongitude", "longitude", "positionGeodetic_Longitude"),
    # what moves
    "aileron": ("aileronDeflection",),
    "rudder": ("rudderDeflection",),
    "elevator": ("elevatorDeflection", "stabilatorDeflection", "horizontalTailDeflection"),
    "throttle": ("powerLeverAngle", "throttlePosition", "thrustLeverAngle"),
    # the coefficients
    "CX": ("aeroBodyForceCoefficient_X", "bodyForceCoefficient_X", "axialForceCoefficient_X"),
    "CY": ("aeroBodyForceCoefficient_Y", "bodyForceCoefficient_Y", "sideForceCoefficient"),
    "CZ": ("aeroBodyForceCoefficient_Z", "bodyForceCoefficient_Z"),
    "CL": ("totalCoefficientOfLift", "liftCoefficient", "coefficientOfLift"),
    "CD": ("totalCoefficientOfDrag", "dragCoefficient", "coefficientOfDrag"),
    "Cl": ("aeroBodyMomentCoefficient_Roll", "rollingMomentCoefficient", "bodyMomentCoefficient_Roll"),
    "Cm": ("aeroBodyMomentCoefficient_Pitch", "pitchingMomentCoefficient", "bodyMomentCoefficient_Pitch"),
    "Cn": ("aeroBodyMomentCoefficient_Yaw", "yawingMomentCoefficient", "bodyMomentCoefficient_Yaw"),
    "area": ("referenceWingArea", "referenceArea"),
    "span": ("referenceWingSpan", "lateralReferenceLength", "referenceSpan"),
    "chord": ("referenceWingChord", "longitudinalReferenceLength", "referenceChord"),
    # the engine
    "force_x": ("thrustBodyForce_X", "bodyThrustForce_X"),
    "force_y": ("thrustBodyForce_Y", "bodyThrustForce_Y"),
    "force_z": ("thrustBodyForce_Z", "bodyThrustForce_Z"),
    "moment_x": ("thrustBodyMoment_Roll", "bodyThrustMoment_Roll"),
    "moment_y": ("thrustBodyMoment_Pitch", "bodyThrustMoment_Pitch"),
    "moment_z": ("thrustBodyMoment_Yaw", "bodyThrustMoment_Yaw"),
    "fuel_flow": ("massDot", "fuelFlow", "fuelMassFlowRate"),
    # the body
    "mass": ("totalMass", "mass"),
    "inertia_xx": ("bodyMomentOfInertia_Roll",),
    "inertia_yy": ("bodyMomentOfInertia_Pitch",),
    "inertia_zz": ("bodyMomentOfInertia_Yaw",),
    "inertia_zx": ("bodyProductOfInertia_ZX", "bodyProductOfInertia_XZ"),
    "inertia_xy": ("bodyProductOfInertia_XY",),
    "inertia_yz": ("bodyProductOfInertia_YZ",),
    "center_of_gravity_x": ("bodyPositionOfCmWrtMrc_X",),
    "center_of_gravity_y": ("bodyPositionOfCmWrtMrc_Y",),
    "center_of_gravity_z": ("bodyPositionOfCmWrtMrc_Z",),
}  # fmt: skip

SI = {  # the unit of each quantity in the program
    **dict.fromkeys(("airspeed", "equivalent_airspeed", "sound_speed"), "m/s"),
    **dict.fromkeys(
        ("altitude", "cross_track", "span", "chord", *(f"center_of_gravity_{axis}" for axis in "xyz")), "m"
    ),
    **dict.fromkeys(("pressure", "dynamic_pressure"), "Pa"),
    **dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), "rad/s"),
    **dict.fromkeys(("angle_of_attack", "sideslip", "roll", "pitch", "yaw", "latitude", "longitude"), "rad"),
    **dict.fromkeys(("aileron", "rudder", "elevator"), "rad"),
    **dict.fromkeys(("mach", "throttle", "CX", "CY", "CZ", "CL", "CD", "Cl", "Cm", "Cn"), "-"),
    **dict.fromkeys((f"force_{axis}" for axis in "xyz"), "N"),
    **dict.fromkeys((f"moment_{axis}" for axis in "xyz"), "N m"),
    **dict.fromkeys((f"inertia_{pair}" for pair in ("xx", "yy", "zz", "zx", "xy", "yz")), "kg m2"),
    "area": "m2",
    "density": "kg/m3",
    "fuel_flow": "kg/s",
    "mass": "kg",
}

# Words of the attribute ``sign`` that say where a positive deflection turns the vehicle: +1 as here, -1 the other way.
_SIGNS = {
    "aileron": ({"rwd", "rightroll", "rightwingdown", "rollsright"}, {"lwd", "leftroll", "leftwingdown", "rollsleft"}),
    "rudder": ({"tel", "trailingedgeleft", "anl", "noseleft"}, {"ter", "trailingedgeright", "anr", "noseright"}),
    "elevator": ({"ted", "trailingedgedown", "and", "nosedown"}, {"teu", "trailingedgeup", "anu", "noseup"}),
}


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


_QUANTITY_OF = {_plain(name): quantity for quantity, names in _SYNONYMS.items() for name in names}


def quantity_of(variable: Variable) -> str | None:
    """What a variable is by its name, else by its identifier; None for what no synonym names."""
    by_name = _QUANTITY_OF.get(_plain(variable.name))
    return by_name or _QUANTITY_OF.get(_plain(variable.identifier)) if len(variable.identifier) > 5 else by_name


def sign_of(quantity: str, variable: Variable) -> int | None:
    """+1 where a deflection is positive as in this program, -1 where it is not; None where the file does not say."""
    if quantity not in _SIGNS:
        return 1
    same, other = _SIGNS[quantity]
    word = _plain(variable.sign)
    return 1 if word in same else -1 if word in other else None


def find_signals(variables: Iterable[Variable]) -> dict[str, Variable]:
    """The variables by their quantity; the first of each counts."""
    found: dict[str, Variable] = {}
    for variable in variables:
        quantity = quantity_of(variable)
        if quantity is not None:
            found.setdefault(quantity, variable)
    return found


def kinds_of(model: Model) -> tuple[str, ...]:
    """What a file holds by its outputs: aerodynamics, propulsion, inertia, control; any of them, or none."""
    outputs = find_signals(model.outputs)
    held = {
        "aerodynamics": ("CX", "CZ", "CL", "CD"),
        "propulsion": ("force_x",),
        "inertia": ("mass", "inertia_xx"),
        "control": ("aileron", "rudder", "elevator"),
    }
    return tuple(kind for kind, names in held.items() if any(name in outputs for name in names))
