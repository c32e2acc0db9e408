"""``worst``, ``rare``, ``tune``: the worst case, a rare failure, better numbers."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import (
    CampaignFile,
    Controller,
    Fresh,
    Json,
    Scheduler,
    Seed,
    Workers,
    metric_option,
)
from abhv_mc.cli.outputs import campaign_folder, output, output_file
from abhv_mc.cli.printing import announce_compiling, answer, beside, print_section, say
from abhv_mc.io.input_error import InputError

if TYPE_CHECKING:
    from abhv_mc.search.tune import TuneFound


def worst(
    campaign: CampaignFile,
    metric: Annotated[str, metric_option("Metric to search.")],
    out: Annotated[Path, output(campaign_folder, "DIR", "For flights and page.")],
    controller: Controller = None,
    above: Annotated[bool, typer.Option("--above", help="Large values are bad.")] = False,
    below: Annotated[
        bool, typer.Option("--below", help="Small values are bad; by default as the campaign.")
    ] = False,
    flights: Annotated[
        int, typer.Option(min=1, help="Flights of the search; as many random ones follow.")
    ] = 2000,
    box: Annotated[
        float, typer.Option(min=0.1, max=8.0, help="Box of unbounded distributions, sigma.")
    ] = 3.0,
    seed: Seed = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    json: Json = None,
    fresh: Fresh = False,
) -> None:
    """Search the box of the dispersions for the worst value of a metric.

    Bounded distributions span their range, others so many sigma. Corners first, then CMA-ES, then a local polish, then
    random flights in the same box for comparison. It says what can happen, not how often. Ctrl-C keeps what was flown.
    """
    if above and below:
        raise InputError("--below", "both --above and --below", "one of them")
    announce_compiling()
    from abhv_mc.api import worst
    from abhv_mc.report.pages.worst_page import make_worst_answer

    bad: Literal["high", "low"] | None = "high" if above else "low" if below else None
    found = worst(
        campaign, out, metric, controller, bad, flights, box, seed, workers, fresh, scheduler
    )
    answer(found.numbers(), json, lambda: print_section(make_worst_answer(found, out).section))
    say(f"report    {out / 'report.html'}", file=beside(json))
    if found.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)


def rare(
    campaign: CampaignFile,
    requirement: Annotated[str, metric_option("Metric of the requirement.")],
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
    from abhv_mc.report.pages.rare_page import make_rare_answer

    announce_compiling()
    found = rare(
        campaign, out, requirement, controller, target_cov, flights, seed, workers, fresh, scheduler
    )
    answer(found.numbers(), json, lambda: print_section(make_rare_answer(found, out).section))
    say(f"report    {out / 'report.html'}", file=beside(json))
    refusal = found.estimate.refusal
    if refusal is not None:
        say(f"no trustworthy estimate: {refusal}", file=sys.stderr)
    if found.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)
    if refusal is not None:
        raise typer.Exit(ExitCode.FAILED)


def tune(
    campaign: CampaignFile,
    out: Annotated[Path, output(output_file, "NEW.yaml", "Controller file to write.")],
    controller: Controller = None,
    block: Annotated[
        Path | None,
        typer.Option(
            "--tune", metavar="FILE", help="File with the block 'tune'.", show_default="CAMPAIGN"
        ),
    ] = None,
    seed: Seed = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    json: Json = None,
) -> None:
    """Tune the free numbers of a controller on common flights, and validate them on fresh ones.

    The new file is written if the paired interval shows a gain within all limits. If not, the best candidate is kept as
    NEW.rejected.yaml, and the exit code is 1. A page beside it shows either. Ctrl-C keeps completed flights.
    """
    page = out.with_suffix(".html")
    output_file(page)
    announce_compiling()
    from abhv_mc.api import tune
    from abhv_mc.report.pages.tune_page import make_tune_answer
    from abhv_mc.search.tune import rejected_file

    def tell(found: "TuneFound") -> None:
        answer(found.as_json(), json, lambda: print_section(make_tune_answer(found).section))

    found = tune(campaign, out, controller, block, seed, workers, scheduler, tell)
    told = beside(json)
    say(f"report    {page}", file=told)
    if not found.shown:
        rejected = rejected_file(out)
        kept = f"; the best candidate is kept in {rejected}" if rejected.exists() else ""
        say(
            f"not shown to be better within the limits: {out} is not written{kept}", file=sys.stderr
        )
        raise typer.Exit(ExitCode.FAILED)
    say(f"controller {out}", file=told)
