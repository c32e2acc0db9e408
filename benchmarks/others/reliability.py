"""Comparison of `rare` and OpenTURNS' SubsetSampling on otbenchmark's reliability problems.

    python -m benchmarks.others.reliability [--seeds 10] [--first-seed 20000] [--problems RP8,R-S]
        [--json FILE]

Both methods have their default settings. `rare` evaluates standard normal points, like the flights
of `abhv-mc rare`; OpenTURNS evaluates the event. Intervals are 95 %; that of OpenTURNS is from the
distribution of its result.
"""

import argparse
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot

from benchmarks.document import write_json
from benchmarks.rare_coverage import Answer, Case, estimate, summarise

PACKAGES = Path(__file__).parent / ".packages"
WANTED = "otbenchmark==0.2.1"
UNREADABLE = ("RP77", "RP110")  # have formulas that OpenTURNS can no longer parse


def import_problems() -> list[Any]:
    """Return otbenchmark's problems.

    The package requires numpy below 2 without need, so that it is installed separately and without
    dependencies.
    """
    if not (PACKAGES / "otbenchmark").is_dir():
        pip = [
            sys.executable,
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--no-deps",
        ]
        subprocess.run([*pip, "--target", str(PACKAGES), WANTED], check=True)
    sys.path.append(str(PACKAGES))
    ot.ComposedDistribution = ot.JointDistribution  # its name until OpenTURNS 1.24
    import otbenchmark

    return [
        problem
        for problem in otbenchmark.ReliabilityBenchmarkProblemList()
        if problem.getName() not in UNREADABLE
    ]


def make_case(problem: Any) -> Case:
    """Return the case of a problem; its severity is the exceedance of the threshold."""
    event = problem.getEvent()
    law, function = event.getAntecedent().getDistribution(), event.getFunction()
    from_normal, threshold = law.getInverseIsoProbabilisticTransformation(), event.getThreshold()
    sign = -1.0 if event.getOperator()(0.0, 1.0) else 1.0  # fails below, or above

    def severity(u: np.ndarray) -> np.ndarray:
        return sign * (np.asarray(function(from_normal(u)))[:, 0] - threshold)

    return Case(problem.getName(), law.getDimension(), severity, 0.0, problem.getProbability())


def sample_subsets(problem: Any, seed: int) -> Answer:
    """Return the result of OpenTURNS' SubsetSampling."""
    ot.RandomGenerator.SetSeed(seed)
    event, function = problem.getEvent(), problem.getEvent().getFunction()
    before = function.getEvaluationCallsNumber()
    method = ot.SubsetSampling(event)
    method.run()
    result = method.getResult()
    interval = result.getProbabilityDistribution().computeBilateralConfidenceInterval(0.95)
    calls = function.getEvaluationCallsNumber() - before
    return Answer(
        result.getProbabilityEstimate(),
        interval.getLowerBound()[0],
        interval.getUpperBound()[0],
        calls,
    )


def study(problems: list[Any], first: int, seeds: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each problem."""
    for problem in problems:
        case = make_case(problem)
        seed_range = range(first, first + seeds)
        yield {
            "case": case.name,
            "dimension": case.dimension,
            "probability": case.probability,
            "seeds": [first, first + seeds - 1],
            "ours": summarise(case, [estimate(case, seed) for seed in seed_range]),
            "openturns": summarise(case, [sample_subsets(problem, seed) for seed in seed_range]),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=20_000)
    parser.add_argument("--problems", default=None, help="comma-separated names; default: all")
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    problems, rows = import_problems(), []
    if arguments.smoke:
        problems, arguments.seeds = problems[:1], 1
    if arguments.problems is not None:
        problems = [
            problem for problem in problems if problem.getName() in arguments.problems.split(",")
        ]
    for row in study(problems, arguments.first_seed, arguments.seeds):
        rows.append(row)
        print(describe(row), flush=True)
    if arguments.json:
        write_json(arguments.json, rows)


def describe(row: dict[str, Any]) -> str:
    """Return a row of the page's table."""
    cells = []
    for method in ("ours", "openturns"):
        summary, seeds = row[method], row["seeds"][1] - row["seeds"][0] + 1
        estimates = seeds - summary["refused"]
        right = round(summary["right_of_given"] * estimates)
        truth = f"{summary['mean_over_truth']:.2f} ± {summary['cov']:.2f}"
        cells += [
            f"{summary['evaluations']:.0f}",
            truth,
            f"{right}" if estimates == seeds else f"{right} of {estimates}",
        ]
    return (
        f"| {row['case']} | {row['dimension']} | {row['probability']:.3g} | "
        + " | ".join(cells)
        + " |"
    )


if __name__ == "__main__":
    main()
