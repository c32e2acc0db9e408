"""Tables on standard output, as wide as their text: a number is never cut, whatever stands at the other end."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table


def print_table(table: "Table") -> None:
    """Print a table without wrapping or cutting its cells, where a terminal is narrow or there is none."""
    from rich.console import Console
    from rich.measure import Measurement

    console = Console()
    width = Measurement.get(console, console.options.update(width=1000), table).maximum
    Console(width=width).print(table)
