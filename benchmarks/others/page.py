"""The tables of docs/explanation/on-others-ground.md, made of what is stored in benchmarks/results.

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
ROWS: dict[str, Callable[[dict[str, Any]], str]] = {
    "reliability": reliability.describe,
    "surrogate": surrogate.describe,
    "sensitivity": sensitivity.describe,
    "gcas": gcas_search.describe,
    "rocketpy": rocketpy_table.describe,
}


def make_table(part: str, rows: Iterable[dict[str, Any]]) -> str:
    """The Markdown of a part."""
    heads = HEADS[part]
    return "\n".join(
        [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *map(ROWS[part], rows)]
    )


def count_right(rows: list[dict[str, Any]], method: str) -> tuple[int, int]:
    """Intervals that hold the published probability, and intervals given."""
    right = given = 0
    for row in rows:
        number = row["seeds"][1] - row["seeds"][0] + 1 - row[method]["refused"]
        right, given = right + round(row[method]["right_of_given"] * number), given + number
    return right, given


def read_rows(part: str) -> list[dict[str, Any]]:
    """What is stored of a part."""
    return json.loads((RESULTS / f"others_{part}.json").read_text(encoding="utf-8"))


def main() -> None:
    for part in HEADS:
        replace_part(PAGE, part, make_table(part, read_rows(part)))


if __name__ == "__main__":
    main()
