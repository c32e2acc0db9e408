"""``abhv-mc compare``: two campaigns on the same samples, flight by flight."""

from pathlib import Path
from typing import Annotated, Any

import typer


def command(
    folder_a: Annotated[Path, typer.Argument(metavar="DIR_A", help="Folder of a campaign.")],
    folder_b: Annotated[Path, typer.Argument(metavar="DIR_B", help="Folder of a campaign on the same samples.")],
    controllers: Annotated[
        str | None, typer.Option(metavar="A,B", help="Compare DIR_A's controller A with DIR_B's controller B.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Pair two campaigns flight by flight: differences with intervals, and failures of only one.

    Without --controllers, each controller that both flew is compared with itself.
    """
    from abhv_mc.cli.names import parse_names
    from abhv_mc.cli.printing import print_json
    from abhv_mc.report.compare import compare_folders

    named = parse_names(controllers) or ()
    found = compare_folders(folder_a, folder_b, named)
    (print_json if json else _print)(found)


def _print(found: dict[str, Any]) -> None:
    from abhv_mc.cli.printing import new_table, print_table
    from abhv_mc.report.metrics import words_of
    from abhv_mc.report.words import p_value, significant

    for pair in found["paired"]:
        headings = "median difference (95 %)", "of 95 % quantiles (95 %)", "A better", "B better", "pairing saved"
        title = f"{pair['a']}  minus  {pair['b']}: {pair['pairs']} flights"
        table = new_table(("metric",), headings, title)
        for metric, numbers in pair["metrics"].items():
            words = words_of(metric)
            gain = numbers["pairing_gain"]
            saved = f"{significant(gain, 2)} times" if gain and gain >= 1.05 else "none"
            row = (str(numbers["a_better"]), str(numbers["b_better"]), saved)
            table.add_row(
                words.label_with_unit, _with_bounds(numbers["median_difference"]), _with_bounds(numbers["q95"]), *row
            )
        print_table(table)
        _print_usage(pair["usage"])
        listed = [*found["requirements"], "reached the end of the mission"]
        for words_, failed in zip(listed, [*pair["requirements"], pair["ended_early"]], strict=True):
            print(
                f"{words_}: only A failed {failed['only_a']}, only B {failed['only_b']}, both {failed['both']} "
                f"(McNemar p {p_value(failed['p_value'])}){_listed(failed)}"
            )


def _with_bounds(interval: dict[str, Any]) -> str:
    from abhv_mc.report.words import bounds, estimate

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


def _print_usage(usage: dict[str, Any]) -> None:
    """Tracking error against control usage: the ratios, and in how many flights less error was bought with more use."""
    from abhv_mc.cli.printing import new_table, print_table
    from abhv_mc.report.metrics import words_of

    headings = "error ratio", "usage ratio", "less error, no more use", "less error, more use"
    table = new_table(("metric",), headings, "A to B: error against surface usage")
    for metric, numbers in usage.items():
        if numbers:
            counts = [str(numbers[f"less_error_{use}_usage"]) for use in ("less", "more")]
            ratios = [_with_bounds(numbers[name]) for name in ("error_ratio", "usage_ratio")]
            table.add_row(words_of(metric).label, *ratios, *counts)
    if table.row_count:
        print_table(table)
