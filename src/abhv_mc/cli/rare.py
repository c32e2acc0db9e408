"""``abhv-mc rare``: the probability of a rare failure."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode


def command(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN.yaml", help="Campaign file.")],
    requirement: Annotated[str, typer.Option(help="Metric of the requirement.")],
    out: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the flights and the page.")],
    controller: Annotated[str | None, typer.Option(help="Controller.", show_default="the first")] = None,
    target_cov: Annotated[float, typer.Option(min=0.01, max=1.0, help="Coefficient of variation to reach.")] = 0.2,
    flights: Annotated[int, typer.Option(min=1, help="Flights at most.")] = 20_000,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed.", show_default="the campaign's")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Flights in parallel.", show_default="cores")] = None,
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help="Fly on this Dask cluster.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the result.")] = None,
    shard: Annotated[str | None, typer.Option(hidden=True)] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Delete what the folder holds first.")] = False,
) -> None:
    """Estimate the probability that a flight breaks a requirement, from 1e-2 to 1e-7, by subset simulation.

    An estimate, not a verdict: verdicts come from random campaigns. Exit code 1 where independent repetitions
    contradict each other, so that there is no trustworthy estimate. Ctrl-C keeps what was flown.
    """
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.cli.searching import refuse_shard, write_json

    refuse_shard(shard)
    announce_compiling()
    from abhv_mc.campaign.search.flights import SearchRequest
    from abhv_mc.campaign.search.rare import RareSettings, find_rare
    from abhv_mc.report.rare_page import write_rare_page

    request = SearchRequest(campaign, out, controller, seed, workers, scheduler, fresh)
    found = find_rare(request, RareSettings(requirement, target_cov, flights))
    numbers = found.numbers()
    page = write_rare_page(found, out / "report.html")
    write_json(json_file, numbers)
    estimate = found.estimate
    if estimate.refusal is None:
        interval = f"{estimate.low:.1e} .. {estimate.high:.1e}"
        print(f"estimate  P(failure) of {found.controller} {estimate.probability:.1e}, 95 % interval {interval}")
    else:
        print(f"no trustworthy estimate: {estimate.refusal}", file=sys.stderr)
    print(f"flights   {estimate.flights}, {found.failures} of them failures")
    print(f"report    {page}")
    if found.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)
    if estimate.refusal is not None:
        raise typer.Exit(ExitCode.FAILED)
