"""``abhv-mc fly``: one nominal flight of each controller."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.outputs import new_folder
from abhv_mc.cli.printing import say

if TYPE_CHECKING:
    from abhv_mc.flight.plan import FlightBlock


def command(
    mission: Annotated[str, typer.Argument(metavar="MISSION", help="Mission file, or the name of a shipped one.")],
    vehicle: Annotated[str, typer.Option(metavar="V", help="Vehicle file, or the name of a shipped one.")] = "ghame_x",
    controller: Annotated[
        list[str] | None,
        typer.Option(metavar="C", help="Controller file or shipped name; may be repeated.", show_default="tlc and lqr"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--output", "-o", callback=new_folder, metavar="DIR", help="Write history and figures here."),
    ] = None,
) -> None:
    """Fly a mission once with each controller, nothing dispersed, and print how it went."""
    from functools import partial

    from abhv_mc.cli.announce import announce_compiling, announce_warnings
    from abhv_mc.io.input_error import InputError
    from abhv_mc.shipped import find_input

    files = [find_input(name, "control") for name in controller or ("tlc", "lqr")]
    names = [file.stem for file in files]
    if len(set(names)) < len(names):
        raise InputError("--controller", None, None, ", ".join(names), "files of different names")
    paths = find_input(vehicle, "vehicle"), find_input(mission, "mission")
    announce_compiling()
    from abhv_mc.flight.fly import fly, nominal_parameters
    from abhv_mc.flight.prepare import prepare
    from abhv_mc.user_code.temporary import run_aside

    plans = {file.stem: prepare(*paths, file, file.stem) for file in files}
    announce_warnings(warning for plan in plans.values() for warning in plan.warnings.tolist())
    if out is not None and len({plan.timing.tick for plan in plans.values()}) > 1:
        raise InputError("--output", None, None, "controllers of different rates", "one folder for each rate")
    nominal = nominal_parameters()
    blocks = {name: run_aside(partial(fly, plan, nominal, record_every=1)) for name, plan in plans.items()}
    _print_table(f"{paths[1].stem} with {paths[0].stem}, nominal", blocks)
    if out is not None:
        from abhv_mc.report.pages.nominal import write_nominal_report

        for path in write_nominal_report(out, plans, {name: block.history[0] for name, block in blocks.items()}):
            say(path)


def _print_table(title: str, blocks: "dict[str, FlightBlock]") -> None:
    from abhv_mc.cli.printing import new_table, print_table
    from abhv_mc.flight.channels import METRICS
    from abhv_mc.flight.outcome import SENTENCES, Outcome

    table = new_table(("metric",), blocks, title, padding=(0, 1, 0, 0))
    outcomes = {name: Outcome(int(block.outcome[0])) for name, block in blocks.items()}
    table.add_row("outcome", *(outcome.code for outcome in outcomes.values()))
    table.add_row("end_time_s", *(f"{block.end_time[0]:g}" for block in blocks.values()), end_section=True)
    for i, metric in enumerate(METRICS):
        table.add_row(metric.name, *(f"{block.metrics[0, i]:.4g}" for block in blocks.values()))
    print_table(table)
    for name, outcome in outcomes.items():
        say(f"{name}: {SENTENCES[outcome]}")
