"""Commands ``fly`` and ``trim`` for nominal flights and trimmed steady flight."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abhv_mc.cli.options import Json, output, output_folder, parse_option
from abhv_mc.cli.printing import (
    announce_warnings,
    new_table,
    print_table,
    say,
    show_result,
    text_stream,
)
from abhv_mc.custom_code.child import run_in_thread
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input
from abhv_mc_vehicle.cli.options import (
    ControllerFiles,
    FlownFile,
    MissionFile,
    Vehicle,
    announce_compiling,
    find_controllers,
)

if TYPE_CHECKING:
    from abhv_mc_vehicle.one_flight.fly_once import OneFlight


def fly(
    mission: MissionFile,
    vehicle: Vehicle = None,
    controllers: ControllerFiles = None,
    out: Annotated[
        Path | None, output(output_folder, "DIR", "Folder for the time histories and figures.")
    ] = None,
    json: Json = None,
) -> None:
    """Simulate the nominal flight of a mission with each controller, and print metrics."""
    from functools import partial

    from abhv_mc_vehicle.one_flight.fly_once import fly_once

    files = find_controllers(controllers)
    vehicle_file = vehicle or find_input(DEFAULT_VEHICLE, "vehicle")
    announce_compiling()
    flights = {
        name: run_in_thread(partial(fly_once, mission, vehicle_file, file))
        for name, file in files.items()
    }
    announce_warnings(
        warning for flight in flights.values() for warning in flight.plan.warnings.tolist()
    )
    if out is not None and len({flight.plan.timing.tick for flight in flights.values()}) > 1:
        raise InputError(
            "--output",
            "the controllers have different sampling rates",
            "a separate command and folder for each rate",
        )
    numbers = {
        name: {"outcome": flight.outcome, "end_time_s": flight.end_time, "metrics": flight.metrics}
        for name, flight in flights.items()
    }
    result = {"mission": mission.stem, "vehicle": vehicle_file.stem, "controllers": numbers}
    title = f"{mission.stem} with {vehicle_file.stem}, nominal"
    show_result(result, json, lambda: _print_flights(title, flights))
    if out is not None:
        from abhv_mc_vehicle.cli.nominal_report import write_nominal_report

        plans = {name: flight.plan for name, flight in flights.items()}
        for path in write_nominal_report(
            out, plans, {name: flight.block.history[0] for name, flight in flights.items()}
        ):
            say(path, file=text_stream(json))


def _print_flights(title: str, flights: "dict[str, OneFlight]") -> None:
    table = new_table(("metric",), flights, title, padding=(0, 1, 0, 0))
    flown = list(flights.values())
    table.add_row("outcome", *(flight.outcome for flight in flown))
    table.add_row("end_time_s", *(f"{flight.end_time:g}" for flight in flown), end_section=True)
    for name in flown[0].metrics:
        table.add_row(name, *(f"{flight.metrics[name]:.4g}" for flight in flown))
    print_table(table)
    for name, flight in flights.items():
        say(f"{name}: {flight.sentence}")


# Rows of the printed table of trims: (JSON key, label, unit, decimal places).
_TRIM_ROWS = (
    ("angle_of_attack_deg", "angle of attack", "deg", 3),
    ("flight_path_angle_deg", "flight path angle", "deg", 3),
    ("elevator_deg", "elevator", "deg", 3),
    ("equivalence_ratio", "throttle", "-", 4),
    ("lift_coefficient", "CL", "-", 5),
    ("drag_coefficient", "CD", "-", 5),
    ("lift_to_drag", "L/D", "-", 3),
    ("c_tn", "CL due to thrust", "-", 5),
    ("drag_n", "drag", "kN", 2),
    ("thrust_n", "thrust", "kN", 2),
    ("thrust_to_weight", "thrust / weight", "-", 3),
    ("load_factor_g", "load factor", "g", 3),
    ("fuel_flow_kgps", "fuel flow", "kg/s", 3),
    ("static_margin_percent", "static margin", "% chord", 2),
    ("short_period_frequency_rad_s", "short period", "rad/s", 3),
    ("short_period_damping", "  damping", "-", 3),
    ("pitch_time_to_double_s", "  time to double", "s", 2),
    ("dutch_roll_frequency_rad_s", "Dutch roll", "rad/s", 3),
    ("dutch_roll_damping", "  damping", "-", 3),
    ("lateral_time_to_double_s", "lateral time to double", "s", 2),
    ("cn_beta_dyn", "Cn_beta_dyn", "1/rad", 4),
    ("lcdp", "LCDP", "1/rad", 4),
    ("aileron_power_1ps2", "aileron power", "1/s2", 3),
    ("rudder_power_1ps2", "rudder power", "1/s2", 3),
    ("elevator_power_1ps2", "elevator power", "1/s2", 3),
)


def _start_option(help_text: str, default: str = "start of the mission", **more: Any) -> Any:
    return typer.Option(help=help_text, show_default=default, **more)


def trim(
    start_file: FlownFile,
    vehicle: Vehicle = None,
    altitude: Annotated[
        str | None,
        _start_option("Geodetic altitude in m or with a unit."),
    ] = None,
    speed: Annotated[str | None, _start_option("Speed in m/s or with a unit.")] = None,
    bank: Annotated[
        str | None,
        _start_option("Bank angles in deg, separated by commas."),
    ] = None,
    flight_path_angle: Annotated[str | None, _start_option("Flight path angle in deg.")] = None,
    mass: Annotated[str | None, _start_option("Mass in kg or with a unit.", "initial mass")] = None,
    latitude: Annotated[str | None, _start_option("Geodetic latitude in deg.", hidden=True)] = None,
    heading: Annotated[
        str | None,
        _start_option("Heading in deg, clockwise from north.", hidden=True),
    ] = None,
    rotating: Annotated[
        bool, typer.Option("--rotating", hidden=True, help="Include the rotation of the Earth.")
    ] = False,
    json: Json = None,
) -> None:
    """Print the controls, forces and flying qualities of trimmed flight at each bank angle.

    The default flight condition is the start of the mission or campaign, or of the mission 'level'
    for a vehicle file. Air and Earth are those of the mission, without wind. Sideslip, aileron and
    rudder are zero. The exit code is 1 if the vehicle cannot be trimmed at one of the bank angles.
    """
    from abhv_mc.api import trim
    from abhv_mc.io.units import ANGLE, LENGTH, MASS, SPEED

    vehicle, mission = _find_mission(start_file, vehicle)

    def read(name: str, text: str | None, dimension: Any, unit: str) -> float | None:
        return None if text is None else parse_option(f"--{name}", text, dimension, unit)

    banks = [parse_option("--bank", text, ANGLE, "deg") for text in (bank or "").split(",") if bank]
    table = trim(
        vehicle,
        read("altitude", altitude, LENGTH, "m"),
        read("speed", speed, SPEED, "m/s"),
        banks or None,
        mission=mission,
        flight_path_angle=read("flight-path-angle", flight_path_angle, ANGLE, "deg"),
        latitude=read("latitude", latitude, ANGLE, "deg"),
        heading=read("heading", heading, ANGLE, "deg"),
        mass=read("mass", mass, MASS, "kg"),
        rotating=rotating,
    )
    announce_warnings(table.attrs["warnings"])
    points = table.reset_index().to_dict("records")
    condition = {name: table.attrs[name] for name in ("altitude_m", "speed_mps", "mass_kg")}
    show_result(
        {"vehicle": str(vehicle), **condition, "points": points},
        json,
        lambda: _print_trims(vehicle, condition["altitude_m"], condition["speed_mps"], points),
    )
    if not table["trimmed"].all():
        raise typer.Exit(1)


def _find_mission(start_file: Path, vehicle: Path | None) -> tuple[Path, Path]:
    """Return the vehicle and the mission of a mission, campaign or vehicle file."""
    from abhv_mc.campaign.file.kinds import find_kind

    kind = find_kind(start_file)
    if kind == "vehicle":
        return vehicle or start_file, find_input("level", "mission")
    if kind == "campaign":
        from abhv_mc.campaign.file.check import read_campaign

        campaign = read_campaign(start_file)
        campaign.simulator.check("a trim")
        vehicle = vehicle or Path(campaign.model.vehicle)
        start_file = Path(campaign.model.mission)
    elif kind != "mission":
        raise InputError(
            start_file, f"this is a {kind} file", "a mission, campaign or vehicle file"
        )
    return vehicle or find_input(DEFAULT_VEHICLE, "vehicle"), start_file


def _print_trims(
    vehicle: Path, altitude: float, speed: float, points: list[dict[str, Any]]
) -> None:
    mach = points[0]["mach"]
    pressure = points[0]["dynamic_pressure_pa"]
    condition = f"{altitude / 1e3:g} km, {speed:g} m/s, Mach {mach:.3f}, {pressure / 1e3:.2f} kPa"
    title = f"{vehicle.stem}: {condition}"
    banks = [f"{point['bank_deg']:g} deg" for point in points]
    table = new_table(("bank angle", ""), banks, title, padding=(0, 1, 0, 0))
    for name, label, unit, digits in _TRIM_ROWS:
        divisor = 1e3 if unit == "kN" else 1.0
        values = [point[name] / divisor for point in points]
        table.add_row(
            label,
            unit.replace("-", ""),
            *(f"{value:.{digits}f}" if math.isfinite(value) else "-" for value in values),
        )
    print_table(table)
    for point in points:
        if point["fault"]:
            say(f"no trim at the bank angle {point['bank_deg']:g} deg: {point['fault']}")
