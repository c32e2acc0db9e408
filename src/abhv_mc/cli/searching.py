"""``worst``, ``rare``, ``tune``: the worst case, a rare failure, better numbers."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import Json
from abhv_mc.cli.outputs import output_file
from abhv_mc.cli.printing import announce_compiling, answer, beside, print_section, say
from abhv_mc.cli.request_options import takes_options
from abhv_mc.requests import RareRequest, TuneRequest, WorstRequest

if TYPE_CHECKING:
    from abhv_mc.search.tune import TuneFound


@takes_options(WorstRequest)
def worst(request: WorstRequest, json: Json = None) -> None:
    """Search the box of the dispersions for the worst value of a metric.

    Bounded distributions span their range, others so many sigma. Corners first, then CMA-ES, then a local polish, then
    random flights in the same box for comparison. It says what can happen, not how often. Ctrl-C keeps what was flown.
    """
    announce_compiling()
    from abhv_mc.api import worst
    from abhv_mc.report.pages.worst_page import make_worst_answer

    found, folder = worst(**vars(request)), Path(request.output)
    answer(found.numbers(), json, lambda: print_section(make_worst_answer(found, folder).section))
    say(f"report    {folder / 'report.html'}", file=beside(json))
    if found.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)


@takes_options(RareRequest)
def rare(request: RareRequest, json: Json = None) -> None:
    """Estimate the probability that a flight breaks a requirement, from 1e-2 to 1e-7, by subset simulation.

    An estimate, not a verdict: verdicts come from random campaigns. Exit code 1 where independent repetitions
    contradict each other, so that there is no trustworthy estimate. Ctrl-C keeps what was flown.
    """
    from abhv_mc.api import rare
    from abhv_mc.report.pages.rare_page import make_rare_answer

    announce_compiling()
    found, folder = rare(**vars(request)), Path(request.output)
    answer(found.numbers(), json, lambda: print_section(make_rare_answer(found, folder).section))
    say(f"report    {folder / 'report.html'}", file=beside(json))
    refusal = found.estimate.refusal
    if refusal is not None:
        say(f"no trustworthy estimate: {refusal}", file=sys.stderr)
    if found.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)
    if refusal is not None:
        raise typer.Exit(ExitCode.FAILED)


@takes_options(TuneRequest)
def tune(request: TuneRequest, json: Json = None) -> None:
    """Tune the free numbers of a controller on common flights, and validate them on fresh ones.

    The new file is written if the paired interval shows a gain within all limits. If not, the best candidate is kept as
    NEW.rejected.yaml, and the exit code is 1. A page beside it shows either. Ctrl-C keeps completed flights.
    """
    page = Path(request.output).with_suffix(".html")
    output_file(page)
    announce_compiling()
    from abhv_mc.api import tune
    from abhv_mc.report.pages.tune_page import make_tune_answer
    from abhv_mc.search.tune import rejected_file

    def tell(found: "TuneFound") -> None:
        answer(found.as_json(), json, lambda: print_section(make_tune_answer(found).section))

    found = tune(**vars(request) | {"tell": tell})
    told = beside(json)
    say(f"report    {page}", file=told)
    if not found.shown:
        out = Path(request.output)
        rejected = rejected_file(out)
        kept = f"; the best candidate is kept in {rejected}" if rejected.exists() else ""
        say(
            f"not shown to be better within the limits: {out} is not written{kept}", file=sys.stderr
        )
        raise typer.Exit(ExitCode.FAILED)
    say(f"controller {request.output}", file=told)
