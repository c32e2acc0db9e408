"""otbenchmark's reliability problems by `rare --surrogate`, beside their published probabilities.

    python -m benchmarks.others.surrogate [--seeds 20] [--first-seed 30000] [--held-out] [--json FILE]

The ten problems are the first of otbenchmark's list with at most ten dimensions; ``--held-out``
takes all others of them. At most 400 evaluations each. Accepted if of all intervals given 90 %
contain the published value, six of ten problems have one in at least half of the repetitions, and
no interval is wider than a factor of 10. The packages are those of `benchmarks.others.reliability`.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.blas_threads import one_blas_thread
from abhv_mc.search.methods.subset import SubsetPlan
from abhv_mc.search.methods.surrogate import MOST_DIMENSIONS, estimate_by_surrogate
from benchmarks.document import write_json
from benchmarks.others.reliability import import_problems, make_case

PROBLEMS = 10
HEADS = ("problem", "inputs", "published", "calls", "given", "right", "mean / published", "widest")


def study(problem: Any, first: int, seeds: int) -> dict[str, Any]:
    """What the seeds of one problem say."""
    case = make_case(problem)
    with one_blas_thread():
        estimates = [
            estimate_by_surrogate(case.severity, SubsetPlan(case.dimension, case.threshold, seed))
            for seed in range(first, first + seeds)
        ]
    given = [one for one in estimates if one.refusal is None]
    missed = [one for one in given if not one.low <= case.probability <= one.high]
    ratios = [one.probability / case.probability for one in given]
    return {
        "case": case.name,
        "dimension": case.dimension,
        "probability": case.probability,
        "seeds": [first, first + seeds - 1],
        "given": len(given),
        "right": len(given) - len(missed),
        "widest": max((one.high / one.low for one in given), default=None),
        "mean_over_published": float(np.mean(ratios)) if given else None,
        "evaluations": float(np.mean([one.flights for one in estimates])),
        "most_evaluations": max(one.flights for one in estimates),
        "missed": [f"{one.low:.3g} .. {one.high:.3g}" for one in missed],
        "refusals": sorted({one.refusal for one in estimates if one.refusal}),
    }


def describe(row: dict[str, Any]) -> str:
    """A row of the page's table."""
    mean, widest = row["mean_over_published"], row["widest"]
    words = [
        row["case"],
        f"{row['dimension']}",
        f"{row['probability']:.3g}",
        f"{row['evaluations']:.0f}",
        f"{row['given']} of {row['seeds'][1] - row['seeds'][0] + 1}",
        f"{row['right']}",
        "-" if mean is None else f"{mean:.2f}",
        "-" if widest is None else f"{widest:.1f}",
    ]
    return f"| {' | '.join(words)} |"


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
    given, right = sum(row["given"] for row in rows), sum(row["right"] for row in rows)
    print(f"{right} of {given} intervals hold the published value", flush=True)


if __name__ == "__main__":
    main()
