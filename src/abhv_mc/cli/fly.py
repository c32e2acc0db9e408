"""``abhv-mc fly``: one nominal flight of each controller."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from abhv_mc.cli.options import ControllerFiles, Json, MissionFile, Vehicle, find_controllers
from abhv_mc.cli.outputs import output, output_folder
from abhv_mc.cli.printing import beside, new_table, print_table, say, show
from abhv_mc.io.input_error import InputError

if TYPE_CHECKING:
    from abhv_mc.one_flight.fly_once import OneFlight


def command(
    mission: MissionFile,
    vehicle: Vehicle = None,
    controllers: ControllerFiles = None,
    out: Annotated[Path | None, output(output_folder, "DIR", "Write history and figures here.")] = None,
    json: Json = None,
) -> None:
    """Fly a mission once with each controller, nothing dispersed, and print how it went."""
    from functools import partial

    from abhv_mc.cli.announce import announce_compiling, announce_warnings
    from abhv_mc.one_flight.fly_once import fly_once
    from abhv_mc.shipped import DEFAULT_VEHICLE, find_input
    from abhv_mc.user_code.child import run_in_thread

    files = find_controllers(controllers)
    craft = vehicle or find_input(DEFAULT_VEHICLE, "vehicle")
    announce_compiling()
    flights = {name: run_in_thread(partial(fly_once, mission, craft, file)) for name, file in files.items()}
    announce_warnings(warning for flight in flights.values() for warning in flight.plan.warnings.tolist())
    if out is not None and len({flight.plan.timing.tick for flight in flights.values()}) > 1:
        raise InputError("--output", "controllers of different rates", "one folder for each rate")
    figures = {
        name: {"outcome": flight.outcome, "end_time_s": flight.end_time, "metrics": flight.metrics}
        for name, flight in flights.items()
    }
    about = {"mission": mission.stem, "vehicle": craft.stem, "controllers": figures}
    show(about, json, lambda: _print_table(f"{mission.stem} with {craft.stem}, nominal", flights))
    if out is not None:
        from abhv_mc.report.pages.nominal import write_nominal_report

        plans = {name: flight.plan for name, flight in flights.items()}
        for path in write_nominal_report(out, plans, {name: one.block.history[0] for name, one in flights.items()}):
            say(path, file=beside(json))


def _print_table(title: str, flights: "dict[str, OneFlight]") -> None:
    table = new_table(("metric",), flights, title, padding=(0, 1, 0, 0))
    table.add_row("outcome", *(flight.outcome for flight in flights.values()))
    table.add_row("end_time_s", *(f"{flight.end_time:g}" for flight in flights.values()), end_section=True)
    for name in next(iter(flights.values())).metrics:
        table.add_row(name, *(f"{flight.metrics[name]:.4g}" for flight in flights.values()))
    print_table(table)
    for name, flight in flights.items():
        say(f"{name}: {flight.sentence}")
