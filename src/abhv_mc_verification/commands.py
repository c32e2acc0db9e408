"""The commands ``verify nesc``, ``verify ghame6``, ``verify all`` and ``bench``."""

import sys
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abhv_mc.cli.options import Json, Junit
from abhv_mc.cli.printing import announce_compiling, answer, new_table, print_table, say
from abhv_mc.io.input_error import InputError

if TYPE_CHECKING:
    from abhv_mc_verification.check_rows import Row

_Scale = Annotated[
    float, typer.Option("--tolerance-scale", metavar="X", help="Multiply every tolerance.")
]

_REFERENCES = Path("tests/reference")


def nesc(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Holds Atmos_NN_Name/Atmos_NN_sim_MM.csv[.gz].")
    ],
    json: Json = None,
    tolerance_scale: _Scale = 1.0,
    junit: Junit = None,
) -> None:
    """Fly NASA's atmospheric check-cases 1 to 16, those that DIR has, and compare with each simulator given.

    Exit code 1 where a difference is outside its tolerance.
    """
    from abhv_mc_verification.nesc import verify_nesc

    _verify(lambda scale: verify_nesc(folder, scale), tolerance_scale, json, junit)


def ghame6(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.csv[.gz]", help="A flight of CADAC++ GHAME6.")
    ],
    json: Json = None,
    tolerance_scale: _Scale = 1.0,
    junit: Junit = None,
) -> None:
    """Replay the recorded surfaces and throttle of a CADAC++ flight and compare the states.

    Exit code 1 where a difference is outside its tolerance.
    """
    from abhv_mc_verification.ghame6 import verify_ghame6

    _verify(lambda scale: verify_ghame6(file, scale), tolerance_scale, json, junit)


def everything(
    references: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            show_default=f"{_REFERENCES}, where it is",
            help="Holds the check-cases (nesc) and recordings (cadac-ghame6).",
        ),
    ] = None,
    json: Json = None,
    tolerance_scale: _Scale = 1.0,
    junit: Junit = None,
) -> None:
    """Show all that is held against published data as one table: others' flights, and the numbers of papers."""
    from abhv_mc_verification.everything import verify_everything

    folder = references or (_REFERENCES if _REFERENCES.is_dir() else None)
    _verify(lambda scale: verify_everything(folder, scale), tolerance_scale, json, junit)


def _verify(
    make_rows: "Callable[[float], list[Row]]", scale: float, json: Path | None, junit: Path | None
) -> None:
    """Print one table, write JSON and JUnit XML, and exit 1 where a row is not as it should be."""
    from abhv_mc_verification.check_rows import all_ok, rows_record

    if not 0.0 < scale < inf:
        raise InputError("--tolerance-scale", f"{scale:g}", "a positive number")
    announce_compiling()
    rows = make_rows(scale)
    answer(rows_record(rows), json, lambda: _print_rows(rows))
    if junit is not None:
        from abhv_mc.report.pages.matrix import Case, make_junit

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


def _print_rows(rows: "list[Row]") -> None:
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
    say(f"{len(rows)} differences, {sum(not row.ok for row in rows)} outside their tolerance")
    alone = sum(not row.judged for row in rows)
    if alone:
        say(
            f"{alone} not judged: their tolerance is what two simulators differ by, and there is a file of one alone"
        )


def _tolerance(row: "Row") -> str:
    return f"{row.tolerance:.2e}" if row.judged else "none"


def bench(
    json: Json = None,
    repetitions: Annotated[
        int, typer.Option(min=1, help="Of each measurement; medians are shown.")
    ] = 9,
) -> None:
    """Measure flights per second and core, starts and memory, with the default campaign; takes a minute or two."""
    from abhv_mc_verification.bench.speed import measure_speed, measure_start, read_operations

    announce_compiling()
    say("flying", file=sys.stderr, flush=True)
    figures = measure_speed(repetitions)
    say("starting anew, and flying the default campaign", file=sys.stderr, flush=True)
    figures |= measure_start(min(repetitions, 5))
    operations = read_operations()
    answer(figures, json, lambda: _print_figures(figures, operations))


def _print_figures(figures: dict[str, Any], operations: dict[str, dict[str, float]]) -> None:
    machine = figures["machine"]
    peak = figures["peak_gflops_per_core"]
    say(f"{machine['cpu']}, {machine['cores']} cores, {machine['simd']}")
    say(
        f"{peak:.1f} GFLOP/s of one core: additions and multiplications, not fused, vectors in registers"
    )
    say(
        f"steps of {1e3 * figures['step_s']:g} ms (RK4), control at {figures['control_rate_hz']:g} Hz"
    )
    for name, one in figures["controllers"].items():
        counts = ", ".join(
            f"{n / 1e6:.2f} M {kind.replace('_', ' ')}" for kind, n in operations[name].items()
        )
        rate, floor = one["flights_per_second_per_core"], one["flops_per_flight"] / 1e6
        say(f"\n{name}")
        say(f"  {rate:.0f} flights per second and core, {one['ms_per_flight']:.2f} ms each")
        say(
            f"  {one['one_at_a_time_ms']:.2f} ms one at a time: batched {one['batched_over_one']:.2f} times as fast"
        )
        say(f"  {one['times_the_floor']:.2f} times the floor of {floor:.1f} M operations: {counts}")
    say(f"\ntwo workers fly {figures['two_workers_over_one']:.2f} times as many as one")
    say(
        f"start to first flight {figures['cold_start_s']:.1f} s cold, {figures['warm_start_s']:.2f} s from the cache"
    )
    say(f"import abhv_mc {1e3 * figures['import_s']:.0f} ms")
    say(f"default campaign with its report: {figures['peak_memory_mb']:.0f} MB")
