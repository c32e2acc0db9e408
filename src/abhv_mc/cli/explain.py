"""``abhv-mc explain``: why a flight failed."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.outputs import new_file
from abhv_mc.cli.printing import say


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A campaign's folder.")],
    flight: Annotated[int, typer.Option(min=0, help="Number of a flight that failed.")],
    controller: Annotated[str | None, typer.Option(help="Name of the controller.", show_default="the first")] = None,
    requirement: Annotated[
        str | None,
        typer.Option(metavar="METRIC", help="Explain why it missed this requirement.", show_default="what it failed"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            callback=new_file,
            metavar="FILE.png",
            help="Where the figure goes.",
            show_default="in DIR",
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    trust_code: Annotated[
        bool, typer.Option("--trust-code", help="Run Python code in the folder that you have not flown yourself.")
    ] = False,
) -> None:
    """Find the smallest set of a failing flight's dispersions that still fails with all others nominal.

    A flight failed that ended early or missed a requirement.
    """
    from abhv_mc.analysis.explain import explain_flight
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.cli.printing import print_json
    from abhv_mc.execution.engine import make_engine
    from abhv_mc.folder.layout import CampaignFolder
    from abhv_mc.report.numbers.results import read_facts
    from abhv_mc.report.pages.explained import explanation_numbers, explanation_words, write_explained_figure
    from abhv_mc.user_code.temporary import run_aside

    paths = CampaignFolder(folder)
    name = controller or read_facts(paths.campaign).controllers[0]
    announce_compiling()
    fly = make_engine().fly
    found = run_aside(lambda: explain_flight(folder, name, flight, fly, requirement, trust_code=trust_code))
    path = out or paths.explained / f"{name}-{flight}.png"
    write_explained_figure(found, path)
    if json:
        print_json(explanation_numbers(found) | {"figure": str(path)})
        return
    say(*explanation_words(found), sep="\n")
    say(f"figure    {path}")
