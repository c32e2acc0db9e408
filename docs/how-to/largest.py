"""Command ``largest``, which prints the flights with the largest values of a metric."""

from pathlib import Path
from typing import Annotated

import typer


def largest(
    folder: Annotated[Path, typer.Argument(help="Results folder.")],
    metric: Annotated[str, typer.Argument(help="Metric, by its column in the flights.")],
    number: Annotated[int, typer.Option(help="Flights to print.")] = 5,
) -> None:
    """Print the flights with the largest values of a metric."""
    import abhv_mc  # inside: `abhv-mc --help` imports this file

    flights = abhv_mc.open_results(folder).flights
    if metric not in flights:
        raise abhv_mc.InputError(folder, f"no metric '{metric}'", "a column of its flights")
    rows = flights.nlargest(number, metric)
    print(rows[["controller", "flight", "outcome", metric]].to_string(index=False))
