"""Command ``largest``, which prints the flights with the largest values of a metric."""

from pathlib import Path
from typing import Annotated

import typer


def largest(
    folder: Annotated[Path, typer.Argument(help="Results folder.")],
    metric: Annotated[str, typer.Argument(help="Column of the metric in the flights table.")],
    number: Annotated[int, typer.Option(help="Number of flights to print.")] = 5,
) -> None:
    """Print the flights with the largest values of a metric."""
    import abhv_mc  # slow import, not needed by `abhv-mc --help`

    flights = abhv_mc.open_results(folder).flights
    if metric not in flights:
        raise abhv_mc.InputError(folder, f"no metric '{metric}'", "a column of the flights table")
    rows = flights.nlargest(number, metric)
    print(rows[["controller", "flight", "outcome", metric]].to_string(index=False))
