"""``abhv-mc adopt``: flights that somebody else has flown, judged."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import Fresh, Json, Junit, NoReport
from abhv_mc.cli.outputs import campaign_folder, output


def command(
    table: Annotated[Path, typer.Argument(metavar="TABLE", help="CSV or Parquet: a row a flight.")],
    campaign: Annotated[
        Path, typer.Option("--campaign", metavar="FILE", help="Says 'inputs' and 'metrics', and no simulator.")
    ],
    out: Annotated[Path | None, output(campaign_folder, "DIR", "Folder.", default="reports/NAME")] = None,
    no_report: NoReport = False,
    fresh: Fresh = False,
    json: Json = None,
    junit: Junit = None,
) -> None:
    """Make a campaign's folder, and its report, of flights that somebody else has flown.

    TABLE has a column for each input and metric, system (of several), outcome and, where wanted, flight. Units stand
    in the heads, as in 'altitude_min [ft]'. Verdicts need 'independent: true' in FILE.
    """
    from abhv_mc.cli.run import finish
    from abhv_mc.execution.adopt import adopt_table
    from abhv_mc.shipped import find_input

    result = adopt_table(table, find_input(campaign, "campaign"), out, fresh)
    finish(result, no_report, json, out or result.folder, junit, flies=False)
