"""``worst`` and ``rare``: the worst case and a rare failure."""

import sys
from pathlib import Path

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import Json
from abhv_mc.cli.printing import announce_compiling, answer, beside, print_section, say
from abhv_mc.cli.request_options import takes_options
from abhv_mc.requests import RareRequest, WorstRequest


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

    An estimate, not a verdict: verdicts come from random campaigns. Exit code 1 without a trustworthy estimate:
    independent repetitions contradict each other, or the surrogate does not converge. Ctrl-C keeps what was flown.
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
