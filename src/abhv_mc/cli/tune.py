"""``abhv-mc tune``: better numbers in a controller's file."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import CampaignFile, Controller, Json, Scheduler, Seed, Workers
from abhv_mc.cli.outputs import output, output_file
from abhv_mc.cli.printing import beside, print_section, say, show

if TYPE_CHECKING:
    from abhv_mc.search.tune import TuneFound


def command(
    campaign: CampaignFile,
    out: Annotated[Path, output(output_file, "NEW.yaml", "Controller file to write.")],
    controller: Controller = None,
    block: Annotated[
        Path | None, typer.Option("--tune", metavar="FILE", help="File with the block 'tune'.", show_default="CAMPAIGN")
    ] = None,
    seed: Seed = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    json: Json = None,
) -> None:
    """Tune the free numbers of a controller on common flights, and validate them on fresh ones.

    Writes the new file only where the paired interval shows a gain within all limits; exit code 1 where it does not. A
    page beside it shows either. Ctrl-C keeps what was flown.
    """
    from abhv_mc.cli.announce import announce_compiling

    page = out.with_suffix(".html")
    output_file(page)
    announce_compiling()
    from abhv_mc.api import tune
    from abhv_mc.report.pages.tune_page import make_tune_answer

    def tell(found: "TuneFound") -> None:
        show(found.as_json(), json, lambda: print_section(make_tune_answer(found).section))

    found = tune(campaign, out, controller, block, seed, workers, scheduler, tell)
    told = beside(json)
    say(f"report    {page}", file=told)
    if not found.shown:
        say("not shown to be better within the limits: no file is written", file=sys.stderr)
        raise typer.Exit(ExitCode.FAILED)
    say(f"controller {out}", file=told)
