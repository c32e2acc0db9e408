"""Comparison of simulated flights with published data: NASA's check-cases, CADAC++, papers.

    python -m benchmarks.verification all|nesc|ghame6 [PATH]

`make verify` runs the command ``all``. The published data are in ``tests/reference``.
"""

import sys
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import Json, Junit
from abhv_mc.cli.printing import announce_compiling, new_table, print_table, say, show_result
from abhv_mc.io.messages import InputError
from abhv_mc.report.pages.matrix import Case, make_junit
from benchmarks.verification.check_rows import Row, all_ok, rows_record
from benchmarks.verification.everything import verify_everything
from benchmarks.verification.ghame6 import verify_ghame6
from benchmarks.verification.nesc import verify_nesc

_Scale = Annotated[
    float,
    typer.Option("--tolerance-scale", metavar="X", help="Factor that multiplies all tolerances."),
]

_REFERENCES = Path(__file__).parents[2] / "tests" / "reference"

app = typer.Typer(no_args_is_help=True, add_completion=False)


@app.command()
def nesc(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="Folder with files Atmos_NN_Name/Atmos_NN_sim_MM.csv[.gz]."
        ),
    ],
    json: Json = None,
    tolerance_scale: _Scale = 1.0,
    junit: Junit = None,
) -> None:
    """Simulate NASA's atmospheric check-cases and compare them with published results.

    Each case from 1 to 16 in DIR is compared with the results of each simulator in DIR.

    The exit code is 1 if a difference is outside its tolerance.
    """
    _verify(lambda scale: verify_nesc(folder, scale), tolerance_scale, json, junit)


@app.command()
def ghame6(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE.csv[.gz]",
            help="File with a recorded flight of the CADAC++ simulation GHAME6.",
        ),
    ],
    json: Json = None,
    tolerance_scale: _Scale = 1.0,
    junit: Junit = None,
) -> None:
    """Replay the recorded controls of a CADAC++ flight and compare the states.

    The exit code is 1 if a difference is outside its tolerance.
    """
    _verify(lambda scale: verify_ghame6(file, scale), tolerance_scale, json, junit)


@app.command("all")
def everything(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            show_default="tests/reference",
            help="Folder with the subfolders nesc (check-cases) and cadac-ghame6 (recordings).",
        ),
    ] = _REFERENCES,
    json: Json = None,
    tolerance_scale: _Scale = 1.0,
    junit: Junit = None,
) -> None:
    """Compare abhv-mc with other simulators and publications, and print one table."""
    _verify(lambda scale: verify_everything(folder, scale), tolerance_scale, json, junit)


def _verify(
    make_rows: Callable[[float], list[Row]], scale: float, json: Path | None, junit: Path | None
) -> None:
    """Print a table, write JSON and JUnit XML, and exit with code 1 if a row fails."""
    if not 0.0 < scale < inf:
        raise InputError("--tolerance-scale", f"found {scale:g}", "a positive number")
    announce_compiling()
    rows = make_rows(scale)
    show_result(rows_record(rows), json, lambda: _print_rows(rows))
    if junit is not None:
        cases = [
            Case(
                f"{row.case} {row.quantity}, against {row.simulator}",
                "FAIL" if not row.ok else "PASS" if row.judged else "NOT JUDGED",
                f"differs by {row.difference:.2e} {row.unit}, tolerance {_tolerance(row)}",
            )
            for row in rows
        ]
        junit.write_text(make_junit("verification", cases), "utf-8")
    if not all_ok(rows):
        raise typer.Exit(1)


def _print_rows(rows: list[Row]) -> None:
    table = new_table(("case", "compared with", "quantity"), ("difference", "tolerance"))
    table.add_column("unit")
    table.add_column()
    for row in rows:
        word = "OUTSIDE" if not row.ok else "ok" if row.judged else "not judged"
        table.add_row(
            row.case,
            row.simulator,
            row.quantity,
            f"{row.difference:.2e}",
            _tolerance(row),
            row.unit,
            word,
        )
    print_table(table)
    say(f"differences outside the tolerance: {sum(not row.ok for row in rows)} of {len(rows)}")
    alone = sum(not row.judged for row in rows)
    if alone:
        say(
            f"differences not judged: {alone}, because the tolerance is the difference between two "
            "simulators, but only one simulator has a file"
        )


def _tolerance(row: Row) -> str:
    return f"{row.tolerance:.2e}" if row.judged else "none"


if __name__ == "__main__":
    try:
        app()
    except InputError as error:
        say(f"error: {error}", file=sys.stderr)
        sys.exit(2)
