"""``abhv-mc whatif``: a campaign's numbers under other dispersions, without flying."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.options import Json, folder_argument
from abhv_mc.cli.printing import new_table, print_table, say, show

if TYPE_CHECKING:
    from collections.abc import Mapping

    from abhv_mc.report.numbers.whatif import Whatif


def command(
    folder: Annotated[Path, folder_argument("Folder of a campaign with sampling: random.")],
    settings: Annotated[
        list[str],
        typer.Option("--set", metavar="K=V", help="For example aero.drag.half_width=12%; may be repeated."),
    ],
    json: Json = None,
) -> None:
    """Estimate results under other dispersions by re-weighting existing flights.

    Refused where the flights do not cover what is asked, or where too few of them count.
    """
    from abhv_mc.analysis.reweight import parse_settings
    from abhv_mc.report.numbers.whatif import make_whatif

    found = make_whatif(folder, parse_settings(settings))
    show(found, json, lambda: _print(found))


def _print(found: "Whatif") -> None:
    from abhv_mc.topics.labels import controller_label
    from abhv_mc.topics.words import bounds, estimate, percent, significant

    for name, after in found.after.items():
        say(f"{name}: {_entry(found.before[name])}  ->  {_entry(after)}")
    if found.stopped_when_proven:
        say("The campaign stopped when proven; the intervals do not allow for that.")
    for name, part in found.controllers.items():
        worth = significant(part.effective_flights)
        title = f"{controller_label(name)}: {part.flights} flights, worth {worth} under the changed dispersions"
        table = new_table(("",), ("quantile", "as flown", "changed"), title)
        for metric in found.asked:
            for level, pair in part.metrics.get(metric, {}).items():
                label = found.words[metric]["label"] if level == "q50" else ""
                cells = [f"{estimate(cell)} ({bounds(cell) or 'no bounds'})" for cell in (pair.before, pair.after)]
                table.add_row(label, f"{level[1:]} %", *cells)
        for entry in part.requirements:
            shares = entry.failure_share.before, entry.failure_share.after
            cells = [f"{percent(cell.value)} ({percent(cell.low)} to {percent(cell.high)})" for cell in shares]
            table.add_row(f"Failed: {entry.words}", "", *cells)
        print_table(table)


def _entry(entry: "Mapping[str, object]") -> str:
    return ", ".join(f"{key} {value}" for key, value in entry.items())
