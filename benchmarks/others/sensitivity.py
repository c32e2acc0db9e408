"""Sobol' indices of published test functions, estimated like the drivers of a report.

    python -m benchmarks.others.sensitivity [--samples 20] [--flights 2000] [--json FILE]

`statistics.drivers` uses the ranks of outputs, so that its true value is the index of the ranks,
computed by pick and freeze on 2**20 points (Saltelli et al. 2010), and not the published index of
the values; both are printed. OpenTURNS' rank-based estimate of first order
(RankSobolSensitivityAlgorithm) is computed for the same ranks; it has no total index.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot
from scipy.stats import qmc, rankdata

from abhv_mc.statistics.drivers import given_data_indices
from abhv_mc.statistics.ranks import standard_ranks
from benchmarks.document import write_json

FIRST_SEED = 30_000
_POINTS = 20  # binary logarithm of the number of points of the reference


@dataclass(frozen=True)
class TestFunction:
    """Function of points in the unit cube [point, input], with its published indices."""

    name: str
    value: Callable[[np.ndarray], np.ndarray]
    first: np.ndarray
    total: np.ndarray


def ishigami(a: float = 7.0, b: float = 0.1) -> TestFunction:
    """Return the function of Ishigami and Homma (ISUMA 1990)."""

    def value(x: np.ndarray) -> np.ndarray:
        x = np.pi * (2.0 * x - 1.0)
        return np.sin(x[:, 0]) + a * np.sin(x[:, 1]) ** 2 + b * x[:, 2] ** 4 * np.sin(x[:, 0])

    alone = np.array([0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0])
    both = b**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)  # of x1 and x3
    variance = alone.sum() + both
    return TestFunction(
        "Ishigami", value, alone / variance, (alone + np.array([both, 0.0, both])) / variance
    )


def sobol_g(a: tuple[float, ...] = (0.0, 1.0, 4.5, 9.0, 99.0, 99.0, 99.0, 99.0)) -> TestFunction:
    """Return the g function of Saltelli and Sobol' (RESS 50, 1995)."""
    weights = np.array(a)

    def value(x: np.ndarray) -> np.ndarray:
        return np.prod((np.abs(4.0 * x - 2.0) + weights) / (1.0 + weights), axis=1)

    alone = 1.0 / (3.0 * (1.0 + weights) ** 2)
    everything = np.prod(1.0 + alone)
    return TestFunction(
        "Sobol' g",
        value,
        alone / (everything - 1.0),
        alone * everything / (1.0 + alone) / (everything - 1.0),
    )


def rank_indices(function: TestFunction) -> tuple[np.ndarray, np.ndarray]:
    """Return first and total indices of the ranks of the output."""
    count = len(function.first)
    a, b = np.split(qmc.Sobol(2 * count, seed=FIRST_SEED).random_base2(_POINTS), 2, axis=1)
    values = function.value(a)
    ordered = np.sort(values)

    def ranks(x: np.ndarray) -> np.ndarray:
        return np.searchsorted(ordered, function.value(x)) / len(ordered)

    of_a, of_b = ranks(a), ranks(b)
    first, total = np.empty(count), np.empty(count)
    for i in range(count):
        mixed = a.copy()
        mixed[:, i] = b[:, i]
        of_mixed = ranks(mixed)
        first[i] = np.mean(of_b * (of_mixed - of_a)) / of_a.var()
        total[i] = 0.5 * np.mean((of_a - of_mixed) ** 2) / of_a.var()
    return first, total


def study(samples: int, flights: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each input of each function."""
    for function in (ishigami(), sobol_g()):
        ours, theirs = [], []
        for seed in range(FIRST_SEED, FIRST_SEED + samples):
            x = np.random.default_rng(seed).random((flights, len(function.first)))
            y = function.value(x)
            ours.append(given_data_indices(x, standard_ranks(y[:, None])))
            theirs.append(
                ot.RankSobolSensitivityAlgorithm(x, rankdata(y)[:, None]).getFirstOrderIndices()
            )
        first, total = rank_indices(function)
        for i in range(len(function.first)):
            yield {
                "function": function.name,
                "input": f"x{i + 1}",
                "flights": flights,
                "published": [float(function.first[i]), float(function.total[i])],
                "of_ranks": [float(first[i]), float(total[i])],
                "ours_first": mean_and_spread([indices.first[i, 0] for indices in ours]),
                "ours_total": mean_and_spread([indices.total[i, 0] for indices in ours]),
                "openturns_first": mean_and_spread([indices[i] for indices in theirs]),
                "named": [int(sum(indices.found[i, 0] for indices in ours)), samples],
            }


def mean_and_spread(values: list[float]) -> list[float]:
    """Return mean and standard deviation."""
    return [float(np.mean(values)), float(np.std(values, ddof=1))]


def describe(row: dict[str, Any]) -> str:
    """Return a row of the page's table."""
    pairs = [f"{first:.3f}, {total:.3f}" for first, total in (row["published"], row["of_ranks"])]
    spreads = [
        f"{mean:.3f} ± {spread:.3f}"
        for mean, spread in (row["ours_first"], row["ours_total"], row["openturns_first"])
    ]
    named, samples = row["named"]
    return (
        f"| {row['function']} {row['input']} | "
        + " | ".join([*pairs, *spreads, f"{named} of {samples}"])
        + " |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=20)
    parser.add_argument("--flights", type=int, default=2000)
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.samples, arguments.flights = 2, 200
    rows = []
    for row in study(arguments.samples, arguments.flights):
        rows.append(row)
        print(describe(row), flush=True)
    if arguments.json:
        write_json(arguments.json, rows)


if __name__ == "__main__":
    main()
