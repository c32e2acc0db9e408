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
    from abhv_mc.report.compare import compare_folders

    named = tuple(part.strip() for part in controllers.split(",")) if controllers else ()
    found = compare_folders(folder_a, folder_b, named)
    if json:
        import json as writer

        print(writer.dumps(found, indent=1, allow_nan=False))
    else:
        _print(found)


def _print(found: dict[str, Any]) -> None:
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Table

    from abhv_mc.cli.printing import print_table
    from abhv_mc.report.metrics import METRIC_WORDS, words_of
    from abhv_mc.report.words import bounds, estimate, p_value

    console = Console()
    for duel in found["duels"]:
        table = Table(title=f"{duel['a']}  minus  {duel['b']}: {duel['pairs']} flights", box=SIMPLE)
        table.add_column("metric", no_wrap=True)
        for heading in ("median", "95 % interval", "95 % quantiles", "A better", "B better"):
            table.add_column(heading, justify="right")
        for metric, numbers in duel["metrics"].items():
            words = METRIC_WORDS.get(metric) or words_of(metric)
            median, high = numbers["median_difference"], numbers["q95"]
            row = (estimate(median), bounds(median), estimate(high), str(numbers["a_better"]), str(numbers["b_better"]))
            table.add_row(words.label_with_unit, *row)
        print_table(table)
        listed = [*found["requirements"], "reached the end of the mission"]
        for words_, failed in zip(listed, [*duel["requirements"], duel["ended_early"]], strict=True):
            console.print(
                f"{words_}: only A failed {failed['only_a']}, only B {failed['only_b']}, both {failed['both']} "
                f"(McNemar p {p_value(failed['p_value'])})",
                highlight=False,
            )
