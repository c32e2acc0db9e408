"""``abhv-mc explain``: why a flight failed."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import Controller, Folder, Json, TrustCode
from abhv_mc.cli.outputs import output_file
from abhv_mc.cli.printing import say, show


def command(
    folder: Folder,
    flight: Annotated[int, typer.Option(min=0, help="Number of a flight that failed.")],
    controller: Controller = None,
    requirement: Annotated[
        str | None,
        typer.Option(metavar="METRIC", help="Explain why it missed this requirement.", show_default="what it failed"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            callback=output_file,
            metavar="FILE.png",
            help="Where the figure goes.",
            show_default="in DIR",
        ),
    ] = None,
    json: Json = None,
    trust_code: TrustCode = False,
) -> None:
    """Find the smallest set of a failing flight's dispersions that still fails with all others nominal.

    A flight failed that ended early or missed a requirement.
    """
    from abhv_mc.analysis.explain import explain_flight
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.execution.engine import make_engine
    from abhv_mc.folder.layout import CampaignFolder
    from abhv_mc.report.numbers.results import read_facts
    from abhv_mc.report.pages.explained import explanation_numbers, explanation_words, write_explained_figure
    from abhv_mc.user_code.run_in_thread import run_in_thread

    paths = CampaignFolder(folder)
    name = controller or read_facts(paths.campaign).controllers[0]
    announce_compiling()
    fly = make_engine().fly
    found = run_in_thread(lambda: explain_flight(folder, name, flight, fly, requirement, trust_code=trust_code))
    path = out or paths.explained / f"{name}-{flight}.png"
    write_explained_figure(found, path)
    words = [*explanation_words(found), f"figure    {path}"]
    show(explanation_numbers(found) | {"figure": str(path)}, json, lambda: say(*words, sep="\n"))
