"""Tables of docs/explanation/on-others-ground.md and benchmarks/results/others.md.

python -m benchmarks.others.page
"""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from benchmarks.document import replace_part
from benchmarks.others import gcas_search, reliability, rocketpy_table, sensitivity, surrogate

RESULTS = Path(__file__).parents[1] / "results"
PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "on-others-ground.md"
LONG_TABLES = RESULTS / "others.md"
_METHOD = ("calls", "estimate", "right")
HEADS: dict[str, tuple[str, ...]] = {
    "reliability": (
        "problem",
        "inputs",
        "published",
        *_METHOD,
        *(f"OT {word}" for word in _METHOD),
    ),
    "surrogate": surrogate.HEADS,
    "sensitivity": (
        "function, input",
        "published: first, total",
        "of ranks: first, total",
        "here: first",
        "here: total",
        "OpenTURNS: first",
        "named as a driver",
    ),
    "gcas": ("seed", "`worst`", "random", "simulated annealing"),
    "rocketpy": (
        "metric",
        "RocketPy: median (95 %)",
        "RocketPy: 5 % quantile",
        "here: median",
        "here: 5 % quantile",
        "RocketPy: share of the variance",
        "here: drivers, the strongest first",
    ),
}
_LONG = ("reliability", "surrogate", "sensitivity")
PAGES = dict.fromkeys(HEADS, PAGE) | dict.fromkeys(_LONG, LONG_TABLES)
ROWS: dict[str, Callable[[dict[str, Any]], str]] = {
    "reliability": reliability.describe,
    "surrogate": surrogate.describe,
    "sensitivity": sensitivity.describe,
    "gcas": gcas_search.describe,
    "rocketpy": rocketpy_table.describe,
}


def make_table(section: str, rows: Iterable[dict[str, Any]]) -> str:
    """Return the table of a section as Markdown."""
    heads = HEADS[section]
    return "\n".join(
        [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *map(ROWS[section], rows)]
    )


def count_right(rows: list[dict[str, Any]], method: str) -> tuple[int, int]:
    """Return the number of intervals with the published probability, and of all intervals."""
    right = intervals = 0
    for row in rows:
        number = row["seeds"][1] - row["seeds"][0] + 1 - row[method]["refused"]
        right, intervals = right + round(row[method]["right_of_given"] * number), intervals + number
    return right, intervals


def read_rows(section: str) -> list[dict[str, Any]]:
    """Return the stored rows of a section."""
    return json.loads((RESULTS / f"others_{section}.json").read_text(encoding="utf-8"))


def main() -> None:
    for section in HEADS:
        replace_part(PAGES[section], section, make_table(section, read_rows(section)))


if __name__ == "__main__":
    main()
