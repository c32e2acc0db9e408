"""How long a brush of `abhv-mc explore` takes among a million flights: python benchmarks/explore.py DIR [FLIGHTS].

The flights of a campaign's folder are repeated, each value moved by up to 5 %, until there are so many.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from abhv_mc.explore.counts import Asked, FlightTable, count_flights, find_ranges, open_flights

BRUSHES = 20


def grow(table: FlightTable, flights: int) -> FlightTable:
    """A table of so many flights, made of the ones that it holds."""
    connection = table.connection
    held, numbers = connection.execute("select count(*), max(flight) + 1 from shown").fetchone()
    columns = list(table.ranges)
    moved = ", ".join(f'"{name}" * (0.95 + 0.1 * random()) as "{name}"' for name in columns)
    copies = -(-flights // held)
    connection.execute("select setseed(0.5)")
    connection.execute(
        f"create table grown as select controller, flight + {numbers} * k as flight, outcome, "  # noqa: S608
        f"rank + {numbers} * k as rank, {moved} from shown, range({copies}) copies(k) limit {flights}"
    )
    connection.execute("drop table shown")
    connection.execute("alter table grown rename to shown")
    return replace(table, ranges=find_ranges(connection, columns))


def draw_asked(table: FlightTable, draw: np.random.Generator) -> Asked:
    """Two columns against each other, and two brushes of a tenth to all of a range."""
    names = list(table.ranges)
    x, y, *brushed = (names[k] for k in draw.integers(len(names), size=4))
    brushes = {}
    for name in brushed:
        low, high = table.ranges[name]
        width = draw.uniform(0.1, 1.0) * (high - low)
        start = draw.uniform(low, high - width)
        brushes[name] = (start, start + width)
    return Asked(x, y, tuple(entry["name"] for entry in table.view["controllers"]), "all", brushes)


def main() -> None:
    flights = int(sys.argv[2]) if len(sys.argv) > 2 else 1_000_000
    draw = np.random.default_rng(1)
    with open_flights(Path(sys.argv[1])) as small:
        table = grow(small, flights)
        taken = []
        for _ in range(BRUSHES):
            asked = draw_asked(table, draw)
            start = time.perf_counter()
            count_flights(table, asked)
            taken.append(time.perf_counter() - start)
    print(f"{flights} flights, {BRUSHES} brushes: median {np.median(taken):.3f} s, largest {max(taken):.3f} s")


if __name__ == "__main__":
    main()
