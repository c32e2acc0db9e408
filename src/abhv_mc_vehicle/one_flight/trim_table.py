"""Table of controls, forces and flying qualities in trim, by bank angle."""

import math
from collections.abc import Sequence
from numbers import Real
from typing import Any

import pandas as pd

from abhv_mc.io.messages import InputError, found_value, joined
from abhv_mc.io.units import ANGLE, LENGTH, MASS, SPEED, format_quantity
from abhv_mc.shipped import DEFAULT_VEHICLE
from abhv_mc_vehicle.control.design.flying_qualities import FlyingQualities, find_flying_qualities
from abhv_mc_vehicle.control.design.reference import make_start_point, on_glide_path
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.prepare import trim_start
from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle
from abhv_mc_vehicle.one_flight.fly_once import Input, Quantity, make_document, to_si
from abhv_mc_vehicle.plant.trim import GRAVITY, TrimPoint
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.table_file import valid_range
from abhv_mc_vehicle.vehicle.warnings import find_vehicle_warnings

COLUMNS = {  # unit of each column, except the bank angle
    "flight_path_angle_deg": "deg",
    "angle_of_attack_deg": "deg",
    "elevator_deg": "deg",
    "equivalence_ratio": "-",
    "mach": "-",
    "dynamic_pressure_pa": "Pa",
    "lift_coefficient": "-",
    "drag_coefficient": "-",
    "lift_to_drag": "-",
    "thrust_to_weight": "-",
    "lift_n": "N",
    "drag_n": "N",
    "thrust_n": "N",
    "c_tn": "-",
    "load_factor_g": "g",
    "fuel_flow_kgps": "kg/s",
    "static_margin_percent": "% chord",
    "short_period_frequency_rad_s": "rad/s",
    "short_period_damping": "-",
    "pitch_time_to_double_s": "s",
    "dutch_roll_frequency_rad_s": "rad/s",
    "dutch_roll_damping": "-",
    "lateral_time_to_double_s": "s",
    "aileron_power_1ps2": "1/s2",
    "rudder_power_1ps2": "1/s2",
    "elevator_power_1ps2": "1/s2",
    "cn_beta_dyn": "1/rad",
    "lcdp": "1/rad",
}
_LATERAL = (  # flying qualities with a least value: column, name and value
    ("cn_beta_dyn", "Cn_beta_dyn", 0.0),
    ("lcdp", "LCDP", 0.0),
    ("lateral_time_to_double_s", "the lateral time to double (s)", 2.0),
)
_LIMITS = {  # limits of the arguments, SI
    "altitude": (LENGTH, -500.0, 86e3),
    "speed": (SPEED, 1.0, 1e4),
    "bank": (ANGLE, -1.56, 1.56),
    "flight_path_angle": (ANGLE, -1.56, 1.56),
    "latitude": (ANGLE, -1.56, 1.56),
    "heading": (ANGLE, -7.0, 7.0),
    "mass": (MASS, 1e-3, 1e7),
}


def trim(
    vehicle: Input = DEFAULT_VEHICLE,
    altitude: Quantity | None = None,
    speed: Quantity | None = None,
    bank: Quantity | Sequence[Quantity] | None = None,
    *,
    mission: Input = "level",
    flight_path_angle: Quantity | None = None,
    latitude: Quantity | None = None,
    heading: Quantity | None = None,
    mass: Quantity | None = None,
    rotating: bool = False,
) -> pd.DataFrame:
    """Return controls, forces and flying qualities of trimmed steady flight.

    Air and Earth are those of the mission, without wind. A vehicle without an engine glides.

    Parameters
    ----------
    vehicle
        Shipped name, path or mapping; see :func:`abhv_mc.fly`.
    altitude, speed, flight_path_angle, latitude, heading
        Flight condition: SI and radians, or text with a unit; by default the mission's start.
    bank
        Bank angle, or several bank angles; by default the mission's start.
    mission
        Mission with the air, the Earth and the default flight condition; see :func:`abhv_mc.fly`.
    mass
        Mass; by default the initial mass.
    rotating
        Whether the Earth rotates.

    Returns
    -------
    pandas.DataFrame
        One row for each bank angle, indexed by ``bank_deg``. ``attrs`` has ``units`` by column,
        ``altitude_m``, ``speed_mps``, ``mass_kg`` and ``warnings`` about implausible properties of
        the vehicle, points outside the tables and ignored wind. ``trimmed`` is False if no trim
        exists within the vehicle's limits, and ``fault`` gives the reason. The static margin is
        aerodynamic, about the centre of gravity with fixed elevator. Frequencies, dampings, times
        to double (infinite if the motion decays) and control powers (angular acceleration per
        deflection) apply to small motions of the attitude with fixed controls, speed and flight
        path. Values of modes that do not exist are NaN.

    Raises
    ------
    InputError
        If an input is invalid.

    Examples
    --------
    >>> table = abhv_mc.trim("abhv", bank=["0 deg", "50 deg"])
    >>> table["trimmed"].tolist()
    [True, True]
    >>> bool(table["angle_of_attack_deg"].is_monotonic_increasing)
    True
    """
    document: Any = make_document("vehicle", vehicle)
    mission_document: Any = make_document("mission", mission)
    flown = read_mission(mission_document)
    bank = flown.start.bank if bank is None else bank
    banks = [bank] if isinstance(bank, str | int | float | Real) else list(bank)
    if not banks:
        raise InputError("bank", "no angle is given", "one or more bank angles")
    conditions = dict(
        altitude=altitude,
        speed=speed,
        flight_path_angle=flight_path_angle,
        latitude=latitude,
        heading=heading,
    )
    start = flown.start.model_copy(
        update={
            name: _quantity(name, value) for name, value in conditions.items() if value is not None
        }
    )
    angles = [_quantity("bank", angle) for angle in banks]
    kilograms = None if mass is None else _quantity("mass", mass)
    craft = load_vehicle(document)
    if craft.constants.surface_limit == 0.0:
        raise InputError(
            document.path,
            "the vehicle has no surfaces",
            "a vehicle with surfaces, which the trim requires",
        )
    earth = flown.make_earth()
    earth = earth if rotating else earth._replace(rotation_rate=0.0)
    weighed = craft.constants.mass_start if kilograms is None else kilograms
    craft = craft._replace(constants=craft.constants._replace(mass_start=weighed))
    rows = []
    trims = []
    for angle in angles:
        banked = start.model_copy(update={"bank": angle})
        case = on_glide_path(flown.model_copy(update={"start": banked}), craft)
        balanced, *_ = trim_start(case, craft, rotating=rotating)
        point = make_start_point(case)
        qualities = find_flying_qualities(craft, earth, point, balanced, weighed)
        rows.append(_make_row(balanced, qualities, craft.constants.area, weighed))
        trims.append(balanced)
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    table["trimmed"] = [not balanced.fault for balanced in trims]
    # An object Series keeps None as the value without a fault.
    table["fault"] = pd.Series([balanced.fault or None for balanced in trims], dtype=object)
    table.index = pd.Index(map(math.degrees, angles), name="bank_deg")
    warnings = _find_range_warnings(craft, trims, start.altitude, weighed)
    for name, label, least in _LATERAL:
        low = [f"{bank:g}" for bank, value in table[name].items() if value <= least]
        if low:
            warnings.append(f"{label} is at most {least:g} at bank angles of {joined(low)} deg")
    if flown.wind != "none":
        warnings.append(f"{mission_document.path}: the trim ignores the wind of the mission")
    table.attrs = {
        "units": {"bank_deg": "deg"} | COLUMNS,
        "altitude_m": start.altitude,
        "speed_mps": start.speed,
        "mass_kg": weighed,
        "warnings": find_vehicle_warnings(craft) + warnings,
    }
    return table


def _find_range_warnings(
    vehicle: Vehicle, trims: list[TrimPoint], altitude: float, mass: float
) -> list[str]:
    """Return a sentence if a trimmed point is outside the ranges of the tables or the limits."""
    outside = []
    for name in ("mach", "angle_of_attack", "elevator", "equivalence_ratio", "altitude", "mass"):
        fixed = {"altitude": altitude, "mass": mass}
        values = [fixed[name] if name in fixed else getattr(trim, name) for trim in trims]
        low, high = valid_range(vehicle, name)
        slack = 1e-9 * (1.0 + max(map(abs, values)))
        if min(values) < low - slack or max(values) > high + slack:
            outside.append(name.replace("_", " "))
    if not outside:
        return []
    return [
        f"a trimmed point is outside the vehicle's tables or limits in {joined(outside)}; table "
        "values at the edge are used"
    ]


def _make_row(
    trim: TrimPoint, qualities: FlyingQualities, area: float, mass: float
) -> tuple[float, ...]:
    """Return a row of the table as the values of COLUMNS."""
    pressure_area = trim.dynamic_pressure * area
    return (
        math.degrees(trim.flight_path_angle),
        math.degrees(trim.angle_of_attack),
        math.degrees(trim.elevator),
        trim.equivalence_ratio,
        trim.mach,
        trim.dynamic_pressure,
        trim.lift / pressure_area,
        trim.drag / pressure_area,
        trim.lift / trim.drag if trim.drag else math.nan,
        trim.thrust / (mass * GRAVITY),
        trim.lift,
        trim.drag,
        trim.thrust,
        trim.c_tn,
        trim.load_factor,
        trim.fuel_flow,
        100.0 * qualities.static_margin,
        *qualities[1:],  # The order of the fields is that of COLUMNS.
    )


def _quantity(name: str, value: Quantity) -> float:
    """Convert an argument to SI. Raise InputError if it is outside its limits."""
    dimension, low, high = _LIMITS[name]
    number = to_si(value, dimension, name)
    if not low <= number <= high:
        raise InputError(
            name,
            found_value(value),
            f"{format_quantity(low, dimension)} to {format_quantity(high, dimension)}",
        )
    return number
