"""Medians and ranges of ``python -m benchmarks.bench`` over several processes.

    python -m benchmarks.limit [--processes 3] [--json FILE]

The results are written to ``benchmarks/results/bench.json`` and a table of
``docs/explanation/performance.md``.
"""

import os
from pathlib import Path
from typing import Any

from benchmarks.document import replace_part, write_json
from benchmarks.spread import describe_machine, find_spread, make_note, make_parser, repeat

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "bench.json"

GOALS = {  # figure: (label, goal as text)
    "peak_gflops_per_core": ("peak of a core, GFLOP/s", ""),
    "flights_per_second_per_core": (
        "flights per second and core",
        "TLC: 700 if the peak is 58 GFLOP/s",
    ),
    "one_at_a_time_ms": ("ms a flight, one at a time", ""),
    "batched_over_one": ("batched / one at a time", "3.5 with AVX-512, 1.8 with AVX2"),
    "flops_per_flight": ("operations a flight", ""),
    "times_the_floor": ("time / floor of the operations", "at most 4"),
    "two_workers_over_one": ("two workers / one", "1.85"),
    "cold_start_s": ("start to first flight, nothing compiled, s", ""),
    "warm_start_s": ("start to first flight, from the cache, s", "at most 1.7"),
    "import_s": ("import abhv_mc, s", "at most 0.3"),
    "peak_memory_mb": ("memory of the default campaign and its report, MB", ""),
}


def make_rows(runs: list[dict[str, Any]]) -> list[str]:
    """Return a row for each figure: median, and lowest to highest of the processes."""
    rows = []
    for name, (label, goal) in GOALS.items():
        if name in runs[0]:
            rows.append(_make_row(label, [run[name] for run in runs], goal))
            continue
        for controller in runs[0]["controllers"]:
            values = [run["controllers"][controller][name] for run in runs]
            of_another = goal.startswith("TLC") and controller != "tlc"
            rows.append(
                _make_row(f"{label}, {controller.upper()}", values, "" if of_another else goal)
            )
    return rows


def _make_row(label: str, values: list[float], goal: str) -> str:
    middle, low, high = (
        f"{value:.3g}" if value < 1e4 else f"{value:,.0f}" for value in find_spread(values)
    )
    return f"| {label} | {middle} | {low} to {high} | {goal} |"


def main() -> None:
    parser = make_parser(__doc__, RESULT)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    options = parser.parse_args()
    load = os.getloadavg()[0]
    runs = repeat(1 if options.smoke else options.processes, "benchmarks.bench", "--json", "-")
    if options.smoke:
        print(*make_rows(runs), sep="\n")
        return
    write_json(options.json, runs)
    head = [
        make_note(describe_machine(load), len(runs)),
        "",
        "| figure | median | lowest to highest | goal |",
        "|---|---|---|---|",
    ]
    replace_part(
        ROOT / "docs" / "explanation" / "performance.md",
        "bench",
        "\n".join([*head, *make_rows(runs)]),
    )


if __name__ == "__main__":
    main()
