"""Steady flight at several bank angles, as a table."""

import math
from collections.abc import Callable, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any

from abhv_mc.io.documents import InputError, describe
from abhv_mc.io.units import ANGLE, LENGTH, MASS, SPEED, format_quantity
from abhv_mc.one_flight.given import Input, Quantity, make_document, to_si
from abhv_mc.shipped import DEFAULT_VEHICLE

if TYPE_CHECKING:
    import pandas as pd

    from abhv_mc.plant.trim import TrimPoint

_COLUMNS: dict[
    str, tuple[str, Callable[["TrimPoint"], float]]
] = {  # unit and value, after the bank
    "flight_path_angle_deg": ("deg", lambda found: math.degrees(found.flight_path_angle)),
    "angle_of_attack_deg": ("deg", lambda found: math.degrees(found.angle_of_attack)),
    "elevator_deg": ("deg", lambda found: math.degrees(found.elevator)),
    "equivalence_ratio": ("-", lambda found: found.equivalence_ratio),
    "thrust_n": ("N", lambda found: found.thrust),
    "lift_n": ("N", lambda found: found.lift),
    "drag_n": ("N", lambda found: found.drag),
    "lift_to_drag": ("-", lambda found: found.lift / found.drag if found.drag else math.nan),
    "c_tn": ("-", lambda found: found.c_tn),
    "load_factor_g": ("g", lambda found: found.load_factor),
    "fuel_flow_kgps": ("kg/s", lambda found: found.fuel_flow),
    "mach": ("-", lambda found: found.mach),
    "dynamic_pressure_pa": ("Pa", lambda found: found.dynamic_pressure),
}
_LIMITS = {  # in SI
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
    altitude: Quantity = "20 km",
    speed: Quantity = "1400 m/s",
    bank: Quantity | Sequence[Quantity] = 0.0,
    *,
    flight_path_angle: Quantity = 0.0,
    latitude: Quantity = "29.3 deg",
    heading: Quantity = "90 deg",
    mass: Quantity | None = None,
    rotating: bool = False,
) -> "pd.DataFrame":
    """The controls of steady flight. A vehicle without an engine is trimmed on its glide path.

    Parameters
    ----------
    vehicle
        Shipped name, path or mapping, as of :func:`abhv_mc.fly`.
    altitude, speed, flight_path_angle, latitude, heading
        Where it flies, and how: SI and radians, or text with a unit.
    bank
        One angle or several.
    mass
        That at the start by default.
    rotating
        Whether the Earth turns.

    Returns
    -------
    pandas.DataFrame
        One row a bank angle, indexed by ``bank_deg``; ``attrs["units"]`` by column. ``trimmed`` is False where the
        vehicle's limits allow no balance, and ``fault`` says why.

    Raises
    ------
    InputError
        For what is wrong with an input.
    """
    import pandas as pd

    from abhv_mc.kernel.world.earth import WGS84
    from abhv_mc.plant.trim import FlightPoint
    from abhv_mc.plant.trim import trim as balance
    from abhv_mc.user_code.vehicle_functions import load_vehicle

    document: Any = make_document("vehicle", vehicle)
    banks = [bank] if isinstance(bank, str | int | float | Real) else list(bank)
    if not banks:
        raise InputError("bank", "no angle", "one or more")
    given = {
        "altitude": altitude,
        "speed": speed,
        "flight_path_angle": flight_path_angle,
        "latitude": latitude,
    }
    point = {name: _quantity(name, value) for name, value in (given | {"heading": heading}).items()}
    angles = [_quantity("bank", angle) for angle in banks]
    kilograms = None if mass is None else _quantity("mass", mass)
    craft = load_vehicle(document)
    if craft.constants.surface_limit == 0.0:
        raise InputError(document.path, "a vehicle without surfaces", "one with them, to trim it")
    earth = WGS84 if rotating else WGS84._replace(rotation_rate=0.0)
    found = [balance(craft, earth, FlightPoint(bank=angle, **point), kilograms) for angle in angles]
    columns: dict[str, list[Any]] = {
        name: [value(each) for each in found] for name, (_, value) in _COLUMNS.items()
    }
    columns["trimmed"] = [not each.fault for each in found]
    columns["fault"] = pd.Series(
        [each.fault or None for each in found], dtype=object
    )  # None stays None
    table = pd.DataFrame(columns).set_index(pd.Index(map(math.degrees, angles), name="bank_deg"))
    start = craft.constants.mass_start
    table.attrs = {
        "units": {"bank_deg": "deg"} | {name: unit for name, (unit, _) in _COLUMNS.items()},
        "mass_kg": start if kilograms is None else kilograms,
    }
    return table


def _quantity(name: str, value: Quantity) -> float:
    """One of _LIMITS in SI."""
    dimension, low, high = _LIMITS[name]
    number = to_si(value, dimension, name)
    if not low <= number <= high:
        wish = f"{format_quantity(low, dimension)} to {format_quantity(high, dimension)}"
        raise InputError(name, describe(value), wish)
    return number
