"""Comparison of `rare --surrogate` with published probabilities of otbenchmark's problems.

    python -m benchmarks.others.surrogate \\
        [--seeds 20] [--first-seed 30000] [--held-out] [--json FILE]

The ten problems are the first of otbenchmark's list with at most ten dimensions; ``--held-out``
runs the remaining problems. Each estimate takes at most 400 evaluations. The method is accepted if

- 90 % of all intervals contain the published value,
- six of ten problems have an interval in at least half of the repetitions, and
- no interval is wider than a factor of 10.

The packages are those of `benchmarks.others.reliability`.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.process_settings import one_blas_thread
from abhv_mc.search.methods.subset import SubsetPlan
from abhv_mc.search.methods.surrogate import MOST_DIMENSIONS, estimate_by_surrogate
from benchmarks.document import write_json
from benchmarks.others.reliability import import_problems, make_case

PROBLEMS = 10
HEADS = ("problem", "inputs", "published", "calls", "given", "right", "mean / published", "widest")


def study(problem: Any, first: int, seeds: int) -> dict[str, Any]:
    """Return the estimates of one problem over its seeds, compared with the published value."""
    case = make_case(problem)
    with one_blas_thread():
        estimates = [
            estimate_by_surrogate(case.severity, SubsetPlan(case.dimension, case.threshold, seed))
            for seed in range(first, first + seeds)
        ]
    intervals = [estimate for estimate in estimates if estimate.refusal is None]
    missed = [
        estimate for estimate in intervals if not estimate.low <= case.probability <= estimate.high
    ]
    ratios = [estimate.probability / case.probability for estimate in intervals]
    return {
        "case": case.name,
        "dimension": case.dimension,
        "probability": case.probability,
        "seeds": [first, first + seeds - 1],
        "given": len(intervals),
        "right": len(intervals) - len(missed),
        "widest": max((estimate.high / estimate.low for estimate in intervals), default=None),
        "mean_over_published": float(np.mean(ratios)) if intervals else None,
        "evaluations": float(np.mean([estimate.flights for estimate in estimates])),
        "most_evaluations": max(estimate.flights for estimate in estimates),
        "missed": [f"{estimate.low:.3g} .. {estimate.high:.3g}" for estimate in missed],
        "refusals": sorted({estimate.refusal for estimate in estimates if estimate.refusal}),
    }


def describe(row: dict[str, Any]) -> str:
    """Return a row of the page's table."""
    mean, widest = row["mean_over_published"], row["widest"]
    cells = [
        row["case"],
        f"{row['dimension']}",
        f"{row['probability']:.3g}",
        f"{row['evaluations']:.0f}",
        f"{row['given']} of {row['seeds'][1] - row['seeds'][0] + 1}",
        f"{row['right']}",
        "-" if mean is None else f"{mean:.2f}",
        "-" if widest is None else f"{widest:.1f}",
    ]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=30_000)
    parser.add_argument("--held-out", action="store_true", help="all but the first ten")
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    problems = [
        problem
        for problem in import_problems()
        if problem.getEvent().getAntecedent().getDimension() <= MOST_DIMENSIONS
    ]
    problems = problems[PROBLEMS:] if arguments.held_out else problems[:PROBLEMS]
    if arguments.smoke:
        problems, arguments.seeds, arguments.json = problems[:1], 1, None
    rows = []
    print(f"| {' | '.join(HEADS)} |\n{'|---' * len(HEADS)}|", flush=True)
    for problem in problems:
        rows.append(study(problem, arguments.first_seed, arguments.seeds))
        print(describe(rows[-1]), flush=True)
        if arguments.json:
            write_json(arguments.json, rows)
    total, right = sum(row["given"] for row in rows), sum(row["right"] for row in rows)
    print(f"{right} of {total} intervals hold the published value", flush=True)


if __name__ == "__main__":
    main()
