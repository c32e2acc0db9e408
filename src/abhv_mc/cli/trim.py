"""``abhv-mc trim``: the controls of steady flight, from the full tables."""

from pathlib import Path
from typing import Annotated, Any

import typer

from abhv_mc.cli.options import Json, VehicleFile
from abhv_mc.cli.printing import new_table, print_table, say, show
from abhv_mc.io.input_error import InputError

# Columns of the table: key of the JSON, heading, unit, divisor, digits.
_COLUMNS = (
    ("bank_deg", "bank", "deg", 1.0, 1),
    ("angle_of_attack_deg", "alpha", "deg", 1.0, 3),
    ("flight_path_angle_deg", "path", "deg", 1.0, 3),
    ("elevator_deg", "elevator", "deg", 1.0, 3),
    ("equivalence_ratio", "eta", "-", 1.0, 4),
    ("thrust_n", "thrust", "kN", 1e3, 1),
    ("lift_to_drag", "L/D", "-", 1.0, 3),
    ("c_tn", "c_tn", "-", 1.0, 5),
    ("load_factor_g", "load", "g", 1.0, 3),
    ("fuel_flow_kgps", "fuel", "kg/s", 1.0, 3),
)


def command(
    vehicle: VehicleFile,
    altitude: Annotated[str, typer.Option(help="Geodetic altitude, m or with a unit.")] = "20 km",
    speed: Annotated[str, typer.Option(help="Speed, m/s or with a unit.")] = "1400 m/s",
    bank: Annotated[str, typer.Option(help="Bank angles, deg, separated by commas.")] = "0",
    flight_path_angle: Annotated[str, typer.Option(help="Climb angle, deg.")] = "0",
    mass: Annotated[str | None, typer.Option(help="Mass, kg or with a unit.", show_default="at the start")] = None,
    latitude: Annotated[str, typer.Option(help="Geodetic latitude, deg.")] = "29.3",
    heading: Annotated[str, typer.Option(help="Heading clockwise from north, deg.")] = "90",
    rotating: Annotated[bool, typer.Option("--rotating", help="Let the Earth turn.")] = False,
    json: Json = None,
) -> None:
    """Print angle of attack, elevator and equivalence ratio of steady flight at each bank angle.

    No sideslip, aileron or rudder; Earth at rest unless told. Exit code 1 where a bank angle has no trim.
    """
    from abhv_mc.flying import trim_rows
    from abhv_mc.user_code.vehicle_functions import load_vehicle

    given = {"altitude": altitude, "speed": speed, "flight_path_angle": flight_path_angle, "latitude": latitude}
    point = {name: _quantity(name, text) for name, text in (given | {"heading": heading}).items()}
    banks = [_quantity("bank", text) for text in bank.split(",")]
    kilograms = None if mass is None else _quantity("mass", mass)

    packed = load_vehicle(vehicle)
    if packed.constants.surface_limit == 0.0:
        raise InputError(vehicle, "a vehicle without surfaces", "one with them, to trim it")
    points = list(trim_rows(packed, point, banks, kilograms, rotating))
    head = {"vehicle": str(vehicle), "altitude_m": point["altitude"], "speed_mps": point["speed"]}
    head |= {"mass_kg": packed.constants.mass_start if kilograms is None else kilograms}
    show(head | {"points": points}, json, lambda: _print_table(vehicle, point["altitude"], point["speed"], points))
    if not all(point["trimmed"] for point in points):
        raise typer.Exit(1)


def _quantity(name: str, text: str) -> float:
    """A quantity of an option in SI; without a unit it is in m, m/s, kg or deg."""
    from abhv_mc.flying import TRIM_LIMITS, trim_quantity
    from abhv_mc.io.units import ANGLE

    bare_unit = "deg" if TRIM_LIMITS[name][0] is ANGLE else None
    return trim_quantity(name, text.strip(), f"--{name.replace('_', '-')}", bare_unit)


def _print_table(vehicle: Path, altitude: float, speed: float, points: list[dict[str, Any]]) -> None:
    mach, pressure = points[0]["mach"], points[0]["dynamic_pressure_pa"]
    title = f"{vehicle.stem}: {altitude / 1e3:g} km, {speed:g} m/s, Mach {mach:.3f}, {pressure / 1e3:.2f} kPa"
    headings = [f"{heading}\n{unit}" for _, heading, unit, _, _ in _COLUMNS]
    table = new_table((), headings, title, padding=(0, 1, 0, 0))
    for point in points:
        table.add_row(*(f"{point[name] / divisor:.{digits}f}" for name, _, _, divisor, digits in _COLUMNS))
    print_table(table)
    for point in points:
        if point["fault"]:
            say(f"no trim at {point['bank_deg']:g} deg of bank: {point['fault']}")
