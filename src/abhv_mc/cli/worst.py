"""``abhv-mc worst``: the worst case over the box of a campaign's dispersions."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import CampaignFile, Controller, Fresh, Json, Scheduler, Seed, Workers
from abhv_mc.cli.outputs import campaign_folder, output
from abhv_mc.cli.printing import beside, print_section, say, show
from abhv_mc.cli.shell_completion import complete_metric
from abhv_mc.io.input_error import InputError


def command(
    campaign: CampaignFile,
    metric: Annotated[str, typer.Option(metavar="METRIC", help="Metric to search.", autocompletion=complete_metric)],
    out: Annotated[Path, output(campaign_folder, "DIR", "For flights and page.")],
    controller: Controller = None,
    above: Annotated[bool, typer.Option("--above", help="Large values are bad.")] = False,
    below: Annotated[bool, typer.Option("--below", help="Small values are bad; by default as the campaign.")] = False,
    flights: Annotated[int, typer.Option(min=1, help="Flights of the search; as many random ones follow.")] = 2000,
    box: Annotated[float, typer.Option(min=0.1, max=8.0, help="Box of unbounded distributions, sigma.")] = 3.0,
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
    from abhv_mc.cli.announce import announce_compiling

    if above and below:
        raise InputError("--below", "both --above and --below", "one of them")
    announce_compiling()
    from abhv_mc.api import worst
    from abhv_mc.report.pages.worst_page import make_worst_answer

    bad: Literal["high", "low"] | None = "high" if above else "low" if below else None
    found = worst(campaign, out, metric, controller, bad, flights, box, seed, workers, fresh, scheduler)
    show(found.numbers(), json, lambda: print_section(make_worst_answer(found, out).section))
    say(f"report    {out / 'report.html'}", file=beside(json))
    if found.failed_to_run:
        raise typer.Exit(ExitCode.INCOMPLETE)
