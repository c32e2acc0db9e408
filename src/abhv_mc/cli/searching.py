"""Commands ``worst``, ``rare`` and ``tighten``, and ``identify`` for test flights."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import (
    FLIGHTS,
    CampaignFile,
    Controller,
    Json,
    Measured,
    Requirements,
    campaign_folder,
    folder_argument,
    output,
    output_file,
    parse_names,
    parse_noise,
    takes_options,
)
from abhv_mc.cli.printing import (
    announce_compiling,
    print_section,
    print_section_table,
    say,
    show_result,
    text_stream,
)
from abhv_mc.io.messages import InputError
from abhv_mc.requests import RareRequest, WorstRequest

if TYPE_CHECKING:
    from abhv_mc.report.numbers.whatif import Whatif
    from abhv_mc.search.tighten import Tightening


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


def tighten(
    folder: Annotated[Path, folder_argument("Results folder of a campaign with random sampling.")],
    dispersions: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME | NAME.KEY=VALUE]...",
            help="Dispersions to narrow, or changed dispersions to estimate, for example "
            "aero.drag.half_width=12%.",
            show_default="all dispersions with a width",
        ),
    ] = None,
    controller: Controller = None,
    requirements: Requirements = None,
    out: Annotated[
        Path | None,
        output(
            campaign_folder,
            "DIR",
            "Results folder for the new flights.",
            "reports/CAMPAIGN_tighten_CONTROLLER_NAMES",
        ),
    ] = None,
    json: Json = None,
) -> None:
    """Find to which width a dispersion must shrink so that a controller passes.

    The dispersions are ranked by re-weighting existing flights. For each, bisection with new
    flights finds the largest width with the verdict PASS, on a grid of 5 % of its width. The width
    one step below is confirmed with independent flights. The exit code is 1 without a confirmed
    width. After Ctrl-C, completed flights are kept; run the same command to resume.

    With NAME.KEY=VALUE, no flights are run: results for other dispersions are estimated by
    re-weighting existing flights. The command then fails if the flights do not cover the new
    distribution or their effective number is too small.
    """
    from abhv_mc.analysis.reweight import parse_settings
    from abhv_mc.report.numbers.whatif import make_whatif
    from abhv_mc.search.tighten import tighten

    names = dispersions or []
    if "=" in "".join(names):
        if controller or out:
            raise InputError("NAME.KEY=VALUE", "found --controller or -o", "neither of them")
        estimates = make_whatif(folder, parse_settings(names), requirements)
        show_result(estimates, json, lambda: _print_whatif(estimates))
        return
    announce_compiling()
    result = tighten(folder, controller, names, output=out, requirements=requirements)
    show_result(result, json, lambda: _print_tightening(result))
    verdicts = result.verdict, *(own.verdict for own in result.dispersions)
    if not any(verdict and verdict.status == "PASS" for verdict in verdicts):
        raise typer.Exit(ExitCode.FAILED)


def _print_tightening(result: "Tightening") -> None:
    from abhv_mc.topics.formatting import percent
    from abhv_mc.topics.topic import Table, make_row

    rows = [
        make_row(
            own.name,
            percent(own.reweighted),
            percent(own.width),
            _entry_text(own.entry or {}),
            f"{own.verdict.status} {own.verdict.failures} of {own.verdict.flights}"
            if own.verdict
            else "no PASS at any width",
        )
        for own in result.dispersions
    ]
    heads = "Dispersion", "Re-weighted width", "Width", "Tightened", "Confirmation"
    verdict = result.verdict
    title = f"{result.controller}: {verdict.status} {verdict.failures} of {verdict.flights}"
    alone = f"{title}; each dispersion narrowed alone"
    print_section_table(Table(alone, heads, (tuple(rows),))) if rows else say(title)
    if result.folder:
        say(f"folder    {result.folder}")


def _print_whatif(estimates: "Whatif") -> None:
    from abhv_mc.topics.topic import Table, controller_label, interval_cell, make_row

    for name, entry in estimates.after.items():
        say(f"{name}: {_entry_text(entry)}")
    if estimates.stopped_when_proven:
        say("stopped when proven: intervals without correction for early stopping")
    for name, own in estimates.controllers.items():
        rows = [
            (*make_row(row.label, row.level), interval_cell(row.before), interval_cell(row.after))
            for row in own.estimates
            if row.metric in estimates.asked
        ]
        title = (
            f"{controller_label(name)}: {own.flights} flights, effective number for the changed "
        )
        title += f"dispersions {own.effective_flights:.0f}"
        print_section_table(Table(title, ("", "Quantile", "Stored", "Changed"), (tuple(rows),)))


def _entry_text(entry: Mapping[str, object]) -> str:
    return ", ".join(f"{key} {value}" for key, value in entry.items())


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
