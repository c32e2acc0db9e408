"""Commands ``worst`` and ``rare``, and ``identify`` for test flights."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import (
    FLIGHTS,
    CampaignFile,
    Controller,
    Json,
    Measured,
    output,
    output_file,
    parse_names,
    parse_noise,
    takes_options,
)
from abhv_mc.cli.printing import announce_compiling, print_section, say, show_result, text_stream
from abhv_mc.requests import RareRequest, WorstRequest


@takes_options(WorstRequest)
def worst(request: WorstRequest, json: Json = None) -> None:
    """Search the ranges of the dispersions for the worst value of a metric.

    A bounded distribution is searched over its range, an unbounded distribution between its
    quantiles at plus and minus --box standard deviations of a normal distribution. The search
    evaluates the corners of this box, then uses CMA-ES and a local search. Random flights in the
    same box are then run for comparison. The result shows which values are possible, but not their
    probabilities. After Ctrl-C, completed flights are kept; run the same command to resume.
    """
    announce_compiling()
    from abhv_mc.api import worst
    from abhv_mc.flights.metrics import MARGIN_NAMES
    from abhv_mc.report.pages.search_pages import make_worst_answer

    if request.metric in MARGIN_NAMES:
        hint = f"'abhv-mc margins {request.campaign} --worst' searches margins at the trim point"
        say(f"{hint} without running flights", file=sys.stderr)
    result, folder = worst(**vars(request)), Path(request.output)
    show_result(
        result.numbers(), json, lambda: print_section(make_worst_answer(result, folder).section)
    )
    say(f"report    {folder / 'report.html'}", file=text_stream(json))
    if result.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)


@takes_options(RareRequest)
def rare(request: RareRequest, json: Json = None) -> None:
    """Estimate the probability (1e-2 to 1e-7) that a flight violates a requirement.

    The method is subset simulation or, with --surrogate, a surrogate of the metric. The result is
    an estimate; verdicts need a campaign with random sampling. The exit code is 1 if the estimate
    cannot be trusted because independent repetitions contradict each other or the surrogate does
    not converge. After Ctrl-C, completed flights are kept; run the same command to resume.
    """
    from abhv_mc.api import rare
    from abhv_mc.report.pages.search_pages import make_rare_answer

    announce_compiling()
    result, folder = rare(**vars(request)), Path(request.output)
    show_result(
        result.numbers(), json, lambda: print_section(make_rare_answer(result, folder).section)
    )
    say(f"report    {folder / 'report.html'}", file=text_stream(json))
    refusal = result.estimate.refusal
    if refusal is not None:
        say(f"no trustworthy estimate: {refusal}", file=sys.stderr)
    if result.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)
    if refusal is not None:
        raise typer.Exit(ExitCode.FAILED)


def identify(
    flights: Annotated[
        list[Path], typer.Argument(metavar="FLIGHT.csv", help=f"{FLIGHTS}".capitalize())
    ],
    campaign: CampaignFile,
    parameters: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Parameters to estimate, separated by commas.",
            show_default="dispersions that vary by vehicle",
        ),
    ] = None,
    controller: Controller = None,
    measured: Measured = None,
    out: Annotated[
        Path | None, output(output_file, "FILE.yaml", "Campaign file with the renewed dispersions.")
    ] = None,
    json: Json = None,
) -> None:
    """Estimate dispersions from test flights, for a campaign that covers the flights.

    The other dispersions of the campaign are nuisance parameters that keep their distributions.
    Parameters that the flights cannot separate are named and not estimated. For several vehicles,
    the spread between vehicles is estimated. The exit code is 1 if the model does not fit.
    """
    from abhv_mc.search.identify import identify
    from abhv_mc.topics.topic import Section, make_records

    names = parse_names(parameters, "--parameters") or ()
    answer = identify(campaign, flights, names, controller, parse_noise(measured), output=out)
    section = Section("Summary", (make_records(answer.texts()),))
    show_result(answer, json, lambda: print_section(section))
    if out is not None:
        say(f"campaign  {out}", file=text_stream(json))
    if not answer.fits:
        raise typer.Exit(ExitCode.FAILED)
