"""``abhv-mc explain``: why a flight failed, or all that did."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import Controller, Folder, Json, TrustCode
from abhv_mc.cli.outputs import output, output_file
from abhv_mc.cli.printing import print_section_table, say, show
from abhv_mc.cli.shell_completion import complete_metric
from abhv_mc.io.input_error import InputError


def command(
    folder: Folder,
    flight: Annotated[int | None, typer.Option(min=0, help="Number of a flight that failed.")] = None,
    every: Annotated[bool, typer.Option("--all", help="Map the failed flights: the 50 worst of a controller.")] = False,
    controller: Controller = None,
    requirement: Annotated[
        str | None,
        typer.Option(
            metavar="METRIC",
            help="Explain why it missed this requirement.",
            show_default="what it failed",
            autocompletion=complete_metric,
        ),
    ] = None,
    out: Annotated[Path | None, output(output_file, "FILE.png", "Where the figure goes.", default="in DIR")] = None,
    json: Json = None,
    trust_code: TrustCode = False,
) -> None:
    """Find the smallest set of a failing flight's dispersions that still fails with all others nominal.

    A flight failed that ended early or missed a requirement. With --all: the same of every controller's failed flights,
    grouped by these sets; 'abhv-mc report' shows them.
    """
    from abhv_mc.cli.announce import announce_compiling

    if every == (flight is not None) or (every and (requirement or out)):
        found = "no flight" if not every and flight is None else "both a flight (or its requirement, or figure) and all"
        raise InputError("--flight", found, "--flight NUMBER, or --all alone")
    announce_compiling()
    if flight is None:
        _map_all(folder, controller, json, trust_code)
    else:
        _explain_one(folder, flight, controller, requirement, out, json, trust_code)


def _explain_one(
    folder: Path, flight: int, controller: str | None, requirement: str | None, out: Path | None, json: Path | None,
    trust_code: bool,
) -> None:  # fmt: skip
    from abhv_mc.analysis.explain import explain_flight
    from abhv_mc.folder.inputs import first_controller
    from abhv_mc.folder.layout import CampaignFolder
    from abhv_mc.report.pages.explained import explanation_numbers, explanation_words, make_explained_figure
    from abhv_mc.simulators.engine import make_engine
    from abhv_mc.user_code.child import run_in_thread

    name = controller or first_controller(folder)
    fly = make_engine().fly
    found = run_in_thread(lambda: explain_flight(folder, name, flight, fly, requirement, trust_code=trust_code))
    path = out or CampaignFolder(folder).explained / f"{name}-{flight}.png"
    words, numbers = explanation_words(found), explanation_numbers(found)
    if found.block.history.size:
        from abhv_mc.topics.figure_style import write_png

        write_png(make_explained_figure(found), path)
        words, numbers = [*words, f"figure    {path}"], numbers | {"figure": str(path)}
    show(numbers, json, lambda: say(*words, sep="\n"))


def _map_all(folder: Path, controller: str | None, json: Path | None, trust_code: bool) -> None:
    from abhv_mc.analysis.failure_map import map_failures, write_map
    from abhv_mc.folder.flown_campaign import read_flown
    from abhv_mc.io.documents import one_of
    from abhv_mc.simulators.engine import make_engine
    from abhv_mc.topics.failures.section import map_table
    from abhv_mc.topics.flights.worst_flights import rank_failed
    from abhv_mc.topics.names import names_of

    results = read_flown(folder)
    if controller is not None and controller not in results.controllers:
        raise InputError(folder, f"no controller '{controller}'", one_of(results.controllers, controller))
    names = results.controllers if controller is None else (controller,)
    failed = {name: rank_failed(results, name) for name in names}
    if not any(failed.values()):
        say("no flight ended early or missed a requirement")
        return
    found = map_failures(folder, failed, make_engine(), trust_code)
    results.refuse_changes()
    path = write_map(folder, found)
    table = map_table(found.controllers, names_of(results))

    def in_words() -> None:
        print_section_table(table)
        say(f"map       {path}; abhv-mc report {folder} shows it")

    show(found.controllers, json, in_words)
