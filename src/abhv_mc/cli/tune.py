"""``abhv-mc tune``: better numbers in a controller's file."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.outputs import keep_apart, new_file
from abhv_mc.cli.printing import say
from abhv_mc.cli.searching import (
    CampaignFile,
    Controller,
    JsonFile,
    Scheduler,
    Seed,
    Shard,
    Workers,
    refuse_shard,
    write_json,
)


def command(
    campaign: CampaignFile,
    out: Annotated[
        Path, typer.Option("--output", "-o", callback=new_file, metavar="NEW.yaml", help="Controller file to write.")
    ],
    controller: Controller = None,
    block: Annotated[
        Path | None, typer.Option("--tune", metavar="FILE", help="File with the block 'tune'.", show_default="CAMPAIGN")
    ] = None,
    seed: Seed = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    json_file: JsonFile = None,
    shard: Shard = None,
) -> None:
    """Tune the free numbers of a controller on common flights, and validate them on fresh ones.

    Writes the new file only where the paired interval shows a gain within all limits; exit code 1 where it does not. A
    page beside it shows either. Ctrl-C keeps what was flown.
    """
    from abhv_mc.cli.announce import announce_compiling

    refuse_shard(shard)
    page = out.with_suffix(".html")
    keep_apart([new_file(page), json_file])
    announce_compiling()
    from abhv_mc.report.pages.tune_page import write_tune_page
    from abhv_mc.search.tune import TuneFound, TuneRequest, tune_controller

    def tell(found: TuneFound) -> None:  # before the new file is there, with which the command would not run again
        write_json(json_file, found.as_json())
        write_tune_page(found, page)

    found = tune_controller(TuneRequest(campaign, out, controller, block, seed, workers, scheduler), tell=tell)
    gain = found.validation.difference
    for side in found.sides:
        bound = "" if side.limit is None else f"  (limit {side.limit:.5g}{'' if side.keeps else ', broken'})"
        say(f"{side.words}: {side.start:.5g} -> {side.best:.5g}{bound}")
    say(f"difference {gain.value:.5g}, 95 % interval {gain.low:.5g} .. {gain.high:.5g}, on fresh flights")
    ends = found.numbers.at_ends(found.tuning.place)
    for key, value in found.numbers.values(found.tuning.place).items():
        say(f"  {key:<40} {value}{'  (at the end of its range)' if key in ends else ''}")
    say(f"report    {page}")
    if not found.shown:
        say("not shown to be better within the limits: no file is written", file=sys.stderr)
        raise typer.Exit(ExitCode.FAILED)
    say(f"controller {out}")
