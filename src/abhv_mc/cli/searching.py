"""Commands ``worst`` and ``rare``, and ``place`` and ``identify`` for test flights."""

import sys
from math import inf
from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import (
    CampaignFile,
    Controller,
    Json,
    output,
    output_file,
    output_folder,
    parse_names,
    takes_options,
)
from abhv_mc.cli.printing import announce_compiling, print_section, say, show_result, text_stream
from abhv_mc.io.messages import InputError
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


Flights = Annotated[
    list[Path],
    typer.Argument(
        metavar="FLIGHT.csv",
        help="Test flights: time histories with the column time (s) and columns of channels, "
        "or tables with a row for each flight: metrics, or the file of its history (history), "
        "its vehicle, and measured parameters.",
    ),
]
Measured = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=SIGMA",
        help="Standard deviation of the measurement error of a channel or metric, in its unit; "
        "repeatable.",
    ),
]


def place(
    flights: Flights,
    campaign: CampaignFile,
    controller: Controller = None,
    measured: Measured = None,
    out: Annotated[Path | None, output(output_folder, "DIR", "Folder for a report page.")] = None,
    json: Json = None,
) -> None:
    """Compare test flights with a campaign, to check whether the dispersed model covers them.

    The command simulates 199 sets of flights, in which flights of one vehicle share the vehicle's
    parameters and measured parameters have their measured values. It prints the rank of each metric
    among the simulated flights, the p-value of each flight, corrected for the number of flights,
    the channel and time at which a history first leaves the simultaneous 95 % band, and a joint
    p-value of several flights.
    """
    from abhv_mc.report.pages.page import write_answer
    from abhv_mc.report.pages.place_page import make_place_answer
    from abhv_mc.search.place import place_flights

    placement = place_flights(
        campaign,
        flights,
        controller,
        _parse_noise(measured or []),
        announce=lambda text: say(text, file=sys.stderr),
    )
    page = make_place_answer(placement, campaign)
    show_result(
        {key: value for key, value in vars(placement).items() if key not in ("bands", "times")},
        json,
        lambda: print_section(page.section),
    )
    if out is not None:
        say(f"report    {write_answer(page, out / 'report.html')}", file=text_stream(json))


def identify(
    flights: Flights,
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
    from abhv_mc.report.pages.place_page import make_identify_section
    from abhv_mc.search.identify import identify

    names = parse_names(parameters, "--parameters") or ()
    answer = identify(
        campaign, flights, names, controller, _parse_noise(measured or []), output=out
    )
    show_result(answer, json, lambda: print_section(make_identify_section(answer)))
    if out is not None:
        say(f"campaign  {out}", file=text_stream(json))
    if not answer.fits:
        raise typer.Exit(ExitCode.FAILED)


def _parse_noise(settings: list[str]) -> dict[str, float]:
    """Parse the noise of each channel. Raise InputError unless all values are positive."""
    noise = {}
    for setting in settings:
        channel, _, number = setting.partition("=")
        try:
            noise[channel] = float(number)
        except ValueError:
            noise[channel] = -1.0
        if not 0.0 < noise[channel] < inf:
            raise InputError(
                "--measured", f"invalid setting '{setting}'", "NAME=SIGMA with a positive number"
            )
    return noise
