"""``abhv-mc verify``: hold flights against other people's, and reports against their data."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli import verify_campaign

if TYPE_CHECKING:
    from abhv_mc.verification.linear_plant import Distance
    from abhv_mc.verification.rows import Row

app = typer.Typer(help="Hold flights against other people's, and reports against their data.", no_args_is_help=True)
app.command("campaign")(verify_campaign.command)

_Json = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the rows as JSON too.")]
_Scale = Annotated[float, typer.Option("--tolerance-scale", metavar="X", help="Multiply every tolerance.")]

_REFERENCES = Path("tests/reference")


@app.command("nesc")
def nesc(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Holds Atmos_NN_Name/Atmos_NN_sim_MM.csv[.gz].")],
    json: _Json = None,
    tolerance_scale: _Scale = 1.0,
) -> None:
    """Fly NASA's atmospheric check-cases 1 to 10, those that DIR has, and compare with each simulator given.

    Exit code 1 where a difference is outside its tolerance.
    """
    from abhv_mc.verification.nesc import verify_nesc

    scale = _prepare(tolerance_scale, json)
    _show([("check-cases", verify_nesc(folder, scale))], json)


@app.command("ghame6")
def ghame6(
    file: Annotated[Path, typer.Argument(metavar="FILE.csv[.gz]", help="A flight of CADAC++ GHAME6.")],
    json: _Json = None,
    tolerance_scale: _Scale = 1.0,
) -> None:
    """Replay the recorded surfaces and throttle of a CADAC++ flight and compare the states.

    Exit code 1 where a difference is outside its tolerance.
    """
    from abhv_mc.verification.ghame6 import verify_ghame6

    scale = _prepare(tolerance_scale, json)
    _show([("recording", verify_ghame6(file, scale))], json)


@app.command("invariants")
def invariants(json: _Json = None, tolerance_scale: _Scale = 1.0) -> None:
    """Check what needs no data: invariants, order, atmosphere, Earth, tables, root finder, loops, vehicles."""
    from abhv_mc.verification.everything import verify_sections

    _show(verify_sections(_prepare(tolerance_scale, json)), json)


@app.command("loops")
def loops(json: _Json = None, tolerance_scale: _Scale = 1.0) -> None:
    """Hold TLC's loops and LQR's gains against their equations, and the whole plant against the design model.

    The second table has no tolerance: it shows how far what the design model leaves out moves the linear plant.
    """
    from abhv_mc.verification.everything import scale_row
    from abhv_mc.verification.linear_plant import compare_linear_plant
    from abhv_mc.verification.loops import verify_loops

    scale = _prepare(tolerance_scale, json)
    rows = [scale_row(row, scale) for row in verify_loops()]
    _show_distances(compare_linear_plant())
    _show([("loops", rows)], json)


@app.command("step")
def step(
    flights: Annotated[int, typer.Option(min=2, help="Dispersed flights.")] = 304,
    controller: Annotated[str, typer.Option(help="One of the shipped control files.")] = "tlc",
    json: _Json = None,
    tolerance_scale: _Scale = 1.0,
) -> None:
    """Halve the integrator's step on the S manoeuvre: every metric moves by less than 1 % of its spread."""
    from abhv_mc.verification.step_study import verify_step

    scale = _prepare(tolerance_scale, json)
    _show([("step study", verify_step(flights, controller, scale))], json)


@app.command("all")
def everything(
    references: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            show_default=f"{_REFERENCES}, where it is",
            help="Holds the check-cases (nesc) and recordings (cadac-ghame6).",
        ),
    ] = None,
    json: _Json = None,
    tolerance_scale: _Scale = 1.0,
) -> None:
    """Show all of the proof as one table: others' flights, invariants, published numbers, and the step study."""
    from abhv_mc.verification.everything import verify_everything

    scale = _prepare(tolerance_scale, json)
    if references is None and _REFERENCES.is_dir():
        references = _REFERENCES
    _show(verify_everything(references, scale), json)


def _prepare(scale: float, json: Path | None) -> float:
    """Refuse what would fail after the flights; the factor of the tolerances."""
    import math

    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.io.input_error import InputError

    if not (math.isfinite(scale) and scale > 0.0):
        raise InputError("--tolerance-scale", None, None, f"{scale:g}", "a positive number")
    if json is not None and not json.parent.is_dir():
        raise InputError(json, None, None, "no folder to write it in", "a file in a folder that exists")
    announce_compiling()
    return scale


def _show_distances(distances: "Iterable[Distance]") -> None:
    """Print how far the plant's Jacobian lies from the design model's."""
    from rich.box import SIMPLE
    from rich.table import Table

    from abhv_mc.cli.printing import print_table

    table = Table(box=SIMPLE, title="Jacobian of the plant minus the design model's, at random nominals")
    headings = ("sub-loop", "plant", "entry, median (1/s)", "entry, worst (1/s)", "pole, median", "pole, worst")
    for heading in headings:
        table.add_column(heading, justify="left" if heading in headings[:2] else "right")
    for distance in distances:
        numbers = (distance.entry_median, distance.entry_worst, distance.pole_median, distance.pole_worst)
        table.add_row(distance.loop, distance.plant, *(f"{number:.1e}" for number in numbers))
    print_table(table)


def _show(sections: "Iterable[tuple[str, list[Row]]]", json: Path | None) -> None:
    """Print one table, write the JSON, and exit 1 where a row is not as it should be."""
    from rich.box import SIMPLE
    from rich.table import Table

    from abhv_mc.cli.printing import print_table
    from abhv_mc.verification.rows import all_ok, write_rows

    table = Table(box=SIMPLE)
    for heading in ("case", "compared with", "quantity", "difference", "tolerance", "unit", ""):
        table.add_column(heading, justify="right" if heading in ("difference", "tolerance") else "left")
    rows = [row for _, section in sections for row in section]
    for row in rows:
        numbers = (f"{row.difference:.2e}", f"{row.tolerance:.2e}")
        table.add_row(row.case, row.simulator, row.quantity, *numbers, row.unit, "ok" if row.ok else "OUTSIDE")
    print_table(table)
    print(f"{len(rows)} differences, {sum(not row.ok for row in rows)} outside their tolerance")
    if json is not None:
        write_rows(json, rows)
    if not all_ok(rows):
        raise typer.Exit(1)
