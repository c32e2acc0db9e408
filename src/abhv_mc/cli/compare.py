"""``abhv-mc compare``: two campaigns on the same samples, flight by flight."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import Json, folder_argument, parse_names
from abhv_mc.cli.outputs import output, output_folder
from abhv_mc.cli.printing import beside, print_section, say, show


def command(
    folder_a: Annotated[Path, folder_argument("Folder of a campaign.", "DIR_A")],
    folder_b: Annotated[Path, folder_argument("Folder of a campaign on the same samples.", "DIR_B")],
    controllers: Annotated[
        str | None,
        typer.Option("--controllers", "--controller", metavar="A,B", help="Compare A of DIR_A with B of DIR_B."),
    ] = None,
    fail_if_worse: Annotated[
        list[str] | None,
        typer.Option(metavar="METRIC=5%", help="Exit 1 where B is worse than that; repeatable."),
    ] = None,
    out: Annotated[Path | None, output(output_folder, "DIR", "Write a page there.")] = None,
    json: Json = None,
) -> None:
    """Pair two campaigns flight by flight: differences with intervals, and failures of only one.

    Without --controllers, each controller that both flew is compared with itself. --fail-if-worse stops B unless it is
    shown to be at most so much worse on more than half of the flights; and where its 95 % or 99.73 % quantile is shown
    to be worse by more, its worst flight is twice as bad, it loses more flights, or misses a requirement more often.
    """
    from abhv_mc.report.numbers.compare import parse_margins
    from abhv_mc.report.pages.compare_page import compare_folders

    margins = parse_margins(fail_if_worse or [])
    found, section, page = compare_folders(folder_a, folder_b, parse_names(controllers) or (), margins, out)
    show(found, json, lambda: print_section(section))
    if page is not None:
        say(f"report    {page}", file=beside(json))
    gates = [gate for pair in found.paired for gate in pair.not_worse.values()]
    if not all(gate.shown for gate in gates):
        raise typer.Exit(ExitCode.FAILED)
