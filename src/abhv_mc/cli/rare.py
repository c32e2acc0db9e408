"""``abhv-mc rare``: the probability of a rare failure."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import CampaignFile, Controller, Fresh, Json, Scheduler, Seed, Workers, parse_option
from abhv_mc.cli.outputs import campaign_folder, output
from abhv_mc.cli.printing import say, show
from abhv_mc.io.input_error import InputError


def command(
    campaign: CampaignFile,
    requirement: Annotated[str, typer.Option(help="Metric of the requirement.")],
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
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.io.units import FRACTION

    cov = parse_option("--target-cov", target_cov, FRACTION)
    if not 0.01 <= cov <= 1.0:
        raise InputError("--target-cov", f"'{target_cov}'", "a number from 0.01 to 1")
    announce_compiling()
    from abhv_mc.report.pages.rare_page import write_rare_page
    from abhv_mc.search.rare import RareSettings, find_rare
    from abhv_mc.search.search_flights import SearchRequest

    request = SearchRequest(campaign, out, controller, seed, workers, scheduler, fresh)
    found = find_rare(request, RareSettings(requirement, cov, flights))
    numbers = found.numbers()
    page = write_rare_page(found, out / "report.html")
    estimate = found.estimate

    def in_words() -> None:
        if estimate.refusal is None:
            interval = f"{estimate.low:.1e} .. {estimate.high:.1e}"
            value = f"{estimate.probability:.1e}, 95 % interval {interval}{found.unwarned}"
            say(f"estimate  P(failure) of {found.controller} {value}")
        say(f"check     {found.second_opinion}")
        say(f"flights   {estimate.flights}, {found.failures} of them failures")
        say(f"report    {page}")

    show(numbers, json, in_words)
    if estimate.refusal is not None:
        say(f"no trustworthy estimate: {estimate.refusal}", file=sys.stderr)
    if found.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)
    if estimate.refusal is not None:
        raise typer.Exit(ExitCode.FAILED)
