"""``abhv-mc compare``: two campaigns on the same samples, flight by flight."""

from pathlib import Path
from typing import Annotated, Any

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import Json, parse_names
from abhv_mc.cli.outputs import output, output_folder
from abhv_mc.cli.printing import beside, new_table, print_table, say, show


def command(
    folder_a: Annotated[Path, typer.Argument(metavar="DIR_A", help="Folder of a campaign.")],
    folder_b: Annotated[Path, typer.Argument(metavar="DIR_B", help="Folder of a campaign on the same samples.")],
    controllers: Annotated[
        str | None,
        typer.Option("--controllers", "--controller", metavar="A,B", help="Compare A of DIR_A with B of DIR_B."),
    ] = None,
    fail_if_worse: Annotated[
        list[str] | None,
        typer.Option(metavar="METRIC=5%", help="Exit 1 where B is not shown to be at most so much worse; repeatable."),
    ] = None,
    out: Annotated[Path | None, output(output_folder, "DIR", "Write a page there.")] = None,
    json: Json = None,
) -> None:
    """Pair two campaigns flight by flight: differences with intervals, and failures of only one.

    Without --controllers, each controller that both flew is compared with itself. --fail-if-worse is a paired test of
    non-inferiority at 5 %: B passes where on more than half of the flights it is shown to be at most so much worse, and
    where it is not shown to lose more flights.
    """
    from abhv_mc.report.numbers.compare import compare_results, parse_margins, read_compared

    named = parse_names(controllers) or ()
    margins = parse_margins(fail_if_worse or [])
    a, b = read_compared(folder_a, folder_b)
    found = compare_results(a, b, named, margins)
    page = None
    if out is not None:
        from abhv_mc.report.pages.compare_page import write_compare_page

        page = write_compare_page(a, b, found, out)
    for results in (a, b):
        results.refuse_changes()
    show(found, json, lambda: _print(found))
    if page is not None:
        say(f"report    {page}", file=beside(json))
    gates = [gate for pair in found["paired"] for gate in pair["not_worse"].values()]
    if not all(gate["shown"] for gate in gates):
        raise typer.Exit(ExitCode.FAILED)


def _print(found: dict[str, Any]) -> None:
    from abhv_mc.report.numbers.compare import gate_words
    from abhv_mc.report.numbers.words import p_value, significant

    for pair in found["paired"]:
        headings = "median difference (95 %)", "of 95 % quantiles (95 %)", "A better", "B better", "pairing saved"
        title = f"{pair['a']}  minus  {pair['b']}: {pair['pairs']} flights"
        table = new_table(("metric",), headings, title)
        for metric, numbers in pair["metrics"].items():
            words = found["words"][metric]
            gain = numbers["pairing_gain"]
            saved = f"{significant(gain, 2)} times" if gain and gain >= 1.05 else "none"
            row = (str(numbers["a_better"]), str(numbers["b_better"]), saved)
            table.add_row(
                words["label_with_unit"], _with_bounds(numbers["median_difference"]), _with_bounds(numbers["q95"]), *row
            )
        print_table(table)
        _print_usage(pair["usage"], found["words"])
        for metric, gate in pair["not_worse"].items():
            say(f"{found['words'][metric]['label']}: {gate_words(gate, 'B')}")
        listed = [*found["requirements"], "reached the end of the mission"]
        for words_, failed in zip(listed, [*pair["requirements"], pair["ended_early"]], strict=True):
            say(
                f"{words_}: only A failed {failed['only_a']}, only B {failed['only_b']}, both {failed['both']} "
                f"(McNemar p {p_value(failed['p_value'])}){_listed(failed)}"
            )


def _with_bounds(interval: dict[str, Any]) -> str:
    from abhv_mc.report.numbers.words import bounds, estimate

    ends = bounds(interval)
    return f"{estimate(interval)} ({ends})" if ends else estimate(interval)


def _listed(failed: dict[str, Any]) -> str:
    """The first flights that failed under one alone."""
    parts = []
    for key in ("a", "b"):
        flights = failed[f"flights_only_{key}"]
        more = ", ..." if failed[f"only_{key}"] > len(flights) else ""
        if flights:
            parts.append(f"; only {key.upper()}: {', '.join(map(str, flights))}{more}")
    return "".join(parts)


def _print_usage(usage: dict[str, Any], words: dict[str, Any]) -> None:
    """Tracking error against control usage: the ratios, and in how many flights less error was bought with more use."""

    headings = "error ratio", "usage ratio", "less error, no more use", "less error, more use"
    table = new_table(("metric",), headings, "A to B: error against surface usage")
    for metric, numbers in usage.items():
        if numbers:
            counts = [str(numbers[f"less_error_{use}_usage"]) for use in ("less", "more")]
            ratios = [_with_bounds(numbers[name]) for name in ("error_ratio", "usage_ratio")]
            table.add_row(words[metric]["label"], *ratios, *counts)
    if table.row_count:
        print_table(table)
