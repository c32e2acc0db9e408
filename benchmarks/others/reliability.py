"""otbenchmark's reliability problems by `rare` and by OpenTURNS' SubsetSampling, beside their published probabilities.

    python -m benchmarks.others.reliability [--seeds 10] [--first-seed 20000] [--problems RP8,R-S] [--json FILE]

Both methods have their default settings. Ours is asked of standard normal points, as `abhv-mc rare` asks its flights;
OpenTURNS' of the event itself. Intervals are of 95 %; OpenTURNS' is that of its result's distribution.
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
UNREADABLE = ("RP77", "RP110")  # their formulas are in a syntax that OpenTURNS no longer reads


def import_problems() -> list[Any]:
    """otbenchmark's problems. It asks for numpy below 2, which it does not need, so it is installed apart and alone."""
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
        one
        for one in otbenchmark.ReliabilityBenchmarkProblemList()
        if one.getName() not in UNREADABLE
    ]


def make_case(problem: Any) -> Case:
    """Severity: how far the problem's function is beyond its threshold."""
    event = problem.getEvent()
    law, function = event.getAntecedent().getDistribution(), event.getFunction()
    from_normal, threshold = law.getInverseIsoProbabilisticTransformation(), event.getThreshold()
    sign = -1.0 if event.getOperator()(0.0, 1.0) else 1.0  # fails below, or above

    def severity(u: np.ndarray) -> np.ndarray:
        return sign * (np.asarray(function(from_normal(u)))[:, 0] - threshold)

    return Case(problem.getName(), law.getDimension(), severity, 0.0, problem.getProbability())


def sample_subsets(problem: Any, seed: int) -> Answer:
    """What OpenTURNS' SubsetSampling says."""
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
    """A row for each problem."""
    for problem in problems:
        case = make_case(problem)
        these = range(first, first + seeds)
        yield {
            "case": case.name,
            "dimension": case.dimension,
            "probability": case.probability,
            "seeds": [first, first + seeds - 1],
            "ours": summarise(case, [estimate(case, seed) for seed in these]),
            "openturns": summarise(case, [sample_subsets(problem, seed) for seed in these]),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=20_000)
    parser.add_argument("--problems", default=None, help="names, with commas; left out: all")
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    problems, rows = import_problems(), []
    if arguments.smoke:
        problems, arguments.seeds = problems[:1], 1
    if arguments.problems is not None:
        problems = [one for one in problems if one.getName() in arguments.problems.split(",")]
    for row in study(problems, arguments.first_seed, arguments.seeds):
        rows.append(row)
        print(describe(row), flush=True)
    if arguments.json:
        write_json(arguments.json, rows)


def describe(row: dict[str, Any]) -> str:
    """A row of the page's table."""
    words = []
    for method in ("ours", "openturns"):
        found, seeds = row[method], row["seeds"][1] - row["seeds"][0] + 1
        given = seeds - found["refused"]
        right = round(found["right_of_given"] * given)
        truth = f"{found['mean_over_truth']:.2f} ± {found['cov']:.2f}"
        words += [
            f"{found['evaluations']:.0f}",
            truth,
            f"{right}" if given == seeds else f"{right} of {given}",
        ]
    return (
        f"| {row['case']} | {row['dimension']} | {row['probability']:.3g} | "
        + " | ".join(words)
        + " |"
    )


if __name__ == "__main__":
    main()
