"""``abhv-mc verify``: hold flights against other people's, and reports against their data."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli import verify_campaign

if TYPE_CHECKING:
    from abhv_mc.verification.rows import Row

app = typer.Typer(help="Hold flights against other people's, and reports against their data.", no_args_is_help=True)
app.command("campaign")(verify_campaign.command)

_Json = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the rows as JSON too.")]
_Scale = Annotated[float, typer.Option(min=0.0, help="Multiply every tolerance.")]


@app.command("nesc")
def nesc(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the check-cases.")],
    json: _Json = None,
    tolerance_scale: _Scale = 1.0,
) -> None:
    """Fly the NESC check-cases of a folder; exit 1 where a difference is outside its tolerance."""
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.verification.nesc import verify_nesc

    announce_compiling()
    _show(verify_nesc(folder, tolerance_scale), json)


@app.command("ghame6")
def ghame6(
    file: Annotated[Path, typer.Argument(metavar="FILE.csv[.gz]", help="Recorded flight.")],
    json: _Json = None,
    tolerance_scale: _Scale = 1.0,
) -> None:
    """Replay a recorded flight of CADAC++ GHAME6; exit 1 where a difference is outside its tolerance."""
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.verification.ghame6 import verify_ghame6

    announce_compiling()
    _show(verify_ghame6(file, tolerance_scale), json)


@app.command("all")
def everything(
    references: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder with the check-cases (nesc) and recordings (cadac-ghame6)."),
    ] = None,
    json: _Json = None,
    tolerance_scale: _Scale = 1.0,
) -> None:
    """Show all the proof that needs no data of others, and with --references that against others' data."""
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.verification.everything import verify_references, verify_sections

    announce_compiling()
    rows = [row for _, section in verify_sections(tolerance_scale) for row in section]
    if references is not None:
        rows += [row for _, section in verify_references(references, tolerance_scale) for row in section]
    _show(rows, json)


def _show(rows: "list[Row]", json: Path | None) -> None:
    from rich.box import SIMPLE
    from rich.table import Table

    from abhv_mc.cli.printing import print_table
    from abhv_mc.verification.rows import all_ok, write_rows

    table = Table(box=SIMPLE)
    for heading in ("case", "compared with", "quantity", "unit", "difference", "tolerance", ""):
        table.add_column(heading, justify="right" if heading in ("difference", "tolerance") else "left")
    for row in rows:
        numbers = (f"{row.difference:.3g}", f"{row.tolerance:.3g}", "ok" if row.ok else "OUTSIDE")
        table.add_row(row.case, row.simulator, row.quantity, row.unit, *numbers)
    print_table(table)
    if json is not None:
        write_rows(json, rows)
    if not all_ok(rows):
        raise typer.Exit(1)
