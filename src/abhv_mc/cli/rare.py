"""``abhv-mc rare``: the probability of a rare failure."""

import sys
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.printing import say
from abhv_mc.cli.searching import (
    CampaignFile,
    Controller,
    Folder,
    Fresh,
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
    requirement: Annotated[str, typer.Option(help="Metric of the requirement.")],
    out: Folder,
    controller: Controller = None,
    target_cov: Annotated[float, typer.Option(min=0.01, max=1.0, help="Coefficient of variation to reach.")] = 0.2,
    flights: Annotated[int, typer.Option(min=1, help="Flights at most.")] = 20_000,
    seed: Seed = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    json_file: JsonFile = None,
    shard: Shard = None,
    fresh: Fresh = False,
) -> None:
    """Estimate the probability that a flight breaks a requirement, from 1e-2 to 1e-7, by subset simulation.

    An estimate, not a verdict: verdicts come from random campaigns. Exit code 1 where independent repetitions
    contradict each other, so that there is no trustworthy estimate. Ctrl-C keeps what was flown.
    """
    from abhv_mc.cli.announce import announce_compiling

    refuse_shard(shard)
    announce_compiling()
    from abhv_mc.report.pages.rare_page import write_rare_page
    from abhv_mc.search.rare import RareSettings, find_rare
    from abhv_mc.search.search_flights import SearchRequest

    request = SearchRequest(campaign, out, controller, seed, workers, scheduler, fresh)
    found = find_rare(request, RareSettings(requirement, target_cov, flights))
    numbers = found.numbers()
    page = write_rare_page(found, out / "report.html")
    write_json(json_file, numbers)
    estimate = found.estimate
    if estimate.refusal is None:
        interval = f"{estimate.low:.1e} .. {estimate.high:.1e}"
        say(f"estimate  P(failure) of {found.controller} {estimate.probability:.1e}, 95 % interval {interval}")
    else:
        say(f"no trustworthy estimate: {estimate.refusal}", file=sys.stderr)
    say(f"flights   {estimate.flights}, {found.failures} of them failures")
    say(f"report    {page}")
    if found.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)
    if estimate.refusal is not None:
        raise typer.Exit(ExitCode.FAILED)
