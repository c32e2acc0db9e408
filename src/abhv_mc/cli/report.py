"""``abhv-mc report``: make the report of a flown campaign again."""

from pathlib import Path
from typing import Annotated, Literal

import typer


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a campaign.")],
    format: Annotated[Literal["html", "md"], typer.Option(help="One HTML file, or Markdown.")] = "html",  # noqa: A002
) -> None:
    """Make the page, the figures and report.json from a campaign's Parquet alone."""
    from abhv_mc.report.build import build_report

    print(build_report(folder, format))
