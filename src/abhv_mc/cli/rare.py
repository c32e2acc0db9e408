"""``abhv-mc rare``: the probability of a rare failure."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import CampaignFile, Controller, Fresh, Json, Scheduler, Seed, Workers
from abhv_mc.cli.outputs import campaign_folder, output
from abhv_mc.cli.printing import beside, print_section, say, show
from abhv_mc.cli.shell_completion import complete_metric


def command(
    campaign: CampaignFile,
    requirement: Annotated[
        str, typer.Option(metavar="METRIC", help="Metric of the requirement.", autocompletion=complete_metric)
    ],
    out: Annotated[Path, output(campaign_folder, "DIR", "For flights and page.")],
    controller: Controller = None,
    target_cov: Annotated[
        str, typer.Option(metavar="COV", help="Coefficient of variation to reach, as 0.2 or 20 %.")
    ] = "20 %",
    flights: Annotated[int, typer.Option(min=1, help="Flights at most.")] = 20_000,
    seed: Seed = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    json: Json = None,
    fresh: Fresh = False,
) -> None:
    """Estimate the probability that a flight breaks a requirement, from 1e-2 to 1e-7, by subset simulation.

    An estimate, not a verdict: verdicts come from random campaigns. Exit code 1 where independent repetitions
    contradict each other, so that there is no trustworthy estimate. Ctrl-C keeps what was flown.
    """
    from abhv_mc.api import rare
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.report.pages.rare_page import make_rare_answer

    announce_compiling()
    found = rare(campaign, out, requirement, controller, target_cov, flights, seed, workers, fresh, scheduler)
    show(found.numbers(), json, lambda: print_section(make_rare_answer(found, out).section))
    say(f"report    {out / 'report.html'}", file=beside(json))
    refusal = found.estimate.refusal
    if refusal is not None:
        say(f"no trustworthy estimate: {refusal}", file=sys.stderr)
    if found.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)
    if refusal is not None:
        raise typer.Exit(ExitCode.FAILED)
