"""``abhv-mc fly``: one nominal flight of each controller."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from abhv_mc.cli.options import ControllerFiles, Json, MissionFile, Vehicle, find_controllers
from abhv_mc.cli.outputs import output, output_folder
from abhv_mc.cli.printing import beside, new_table, print_table, say, show
from abhv_mc.io.input_error import InputError

if TYPE_CHECKING:
    from abhv_mc.flight.plan import FlightBlock


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
    from abhv_mc.shipped import find_input

    files = find_controllers(controllers)
    paths = vehicle or find_input("ghame_x", "vehicle"), mission
    announce_compiling()
    from abhv_mc.flight.fly import fly, nominal_parameters
    from abhv_mc.flight.outcome import Outcome
    from abhv_mc.flight.prepare import prepare
    from abhv_mc.simulators.end_sentence import describe_end
    from abhv_mc.user_code.run_in_thread import run_in_thread

    plans = {name: prepare(*paths, file, name).lean_for(()) for name, file in files.items()}
    announce_warnings(warning for plan in plans.values() for warning in plan.warnings.tolist())
    if out is not None and len({plan.timing.tick for plan in plans.values()}) > 1:
        raise InputError("--output", "controllers of different rates", "one folder for each rate")
    nominal = nominal_parameters()
    blocks = {name: run_in_thread(partial(fly, plan, nominal, record_every=1)) for name, plan in plans.items()}
    ends = [describe_end(plans[name], nominal, Outcome(int(block.outcome[0]))) for name, block in blocks.items()]
    figures = {"mission": mission.stem, "vehicle": paths[0].stem, "controllers": _make_figures(blocks)}
    show(figures, json, lambda: _print_table(f"{mission.stem} with {paths[0].stem}, nominal", blocks, ends))
    if out is not None:
        from abhv_mc.report.pages.nominal import write_nominal_report

        for path in write_nominal_report(out, plans, {name: block.history[0] for name, block in blocks.items()}):
            say(path, file=beside(json))


def _make_figures(blocks: "dict[str, FlightBlock]") -> dict[str, Any]:
    from abhv_mc.flight.metrics import METRICS
    from abhv_mc.flight.outcome import Outcome

    names = [metric.name for metric in METRICS]
    return {
        name: {
            "outcome": Outcome(int(block.outcome[0])).code,
            "end_time_s": block.end_time[0],
            "metrics": dict(zip(names, block.metrics[0], strict=False)),
        }
        for name, block in blocks.items()
    }


def _print_table(title: str, blocks: "dict[str, FlightBlock]", ends: list[str]) -> None:
    from abhv_mc.flight.metrics import METRICS
    from abhv_mc.flight.outcome import Outcome

    table = new_table(("metric",), blocks, title, padding=(0, 1, 0, 0))
    outcomes = {name: Outcome(int(block.outcome[0])) for name, block in blocks.items()}
    table.add_row("outcome", *(outcome.code for outcome in outcomes.values()))
    table.add_row("end_time_s", *(f"{block.end_time[0]:g}" for block in blocks.values()), end_section=True)
    for i, metric in enumerate(METRICS):
        table.add_row(metric.name, *(f"{block.metrics[0, i]:.4g}" for block in blocks.values()))
    print_table(table)
    for name, end in zip(blocks, ends, strict=True):
        say(f"{name}: {end}")
