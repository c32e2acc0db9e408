"""``abhv-mc trim``: the controls of steady flight, from the full tables."""

from pathlib import Path
from typing import Annotated, Any

import typer

from abhv_mc.cli.options import Json, VehicleFile
from abhv_mc.cli.printing import new_table, print_table, say, show

# Columns of the table: key of the JSON, heading, unit, divisor, digits.
_COLUMNS = (
    ("bank_deg", "bank", "deg", 1.0, 1),
    ("angle_of_attack_deg", "alpha", "deg", 1.0, 3),
    ("flight_path_angle_deg", "path", "deg", 1.0, 3),
    ("elevator_deg", "elevator", "deg", 1.0, 3),
    ("equivalence_ratio", "throttle", "-", 1.0, 4),
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
    """Print angle of attack, elevator and throttle of steady flight at each bank angle.

    No sideslip, aileron or rudder; Earth at rest unless told. Exit code 1 where a bank angle has no trim.
    """
    from abhv_mc.api import trim
    from abhv_mc.cli.options import parse_option
    from abhv_mc.io.units import ANGLE, LENGTH, MASS, SPEED

    def in_degrees(name: str, text: str) -> float:
        return parse_option(f"--{name}", text, ANGLE, "deg")

    height, pace = parse_option("--altitude", altitude, LENGTH, "m"), parse_option("--speed", speed, SPEED, "m/s")
    table = trim(
        vehicle,
        height,
        pace,
        [in_degrees("bank", text) for text in bank.split(",")],
        flight_path_angle=in_degrees("flight-path-angle", flight_path_angle),
        latitude=in_degrees("latitude", latitude),
        heading=in_degrees("heading", heading),
        mass=None if mass is None else parse_option("--mass", mass, MASS, "kg"),
        rotating=rotating,
    )
    points = table.reset_index().to_dict("records")
    head = {"vehicle": str(vehicle), "altitude_m": height, "speed_mps": pace, "mass_kg": table.attrs["mass_kg"]}
    show(head | {"points": points}, json, lambda: _print_table(vehicle, height, pace, points))
    if not table["trimmed"].all():
        raise typer.Exit(1)


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
