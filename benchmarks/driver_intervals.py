"""Coverage study of the intervals of rank regression coefficients.

    python benchmarks/driver_intervals.py [--smoke]

The true coefficients of a case are those of 200,000 flights. The script prints the share of
campaigns whose interval misses the true coefficient, for all inputs of a case together and for the
worst input.
"""

import sys
from collections.abc import Callable

import numpy as np

from abhv_mc.statistics.drivers import rank_drivers

CAMPAIGNS = 400
FLIGHTS = 300, 2000


def _normal(draw: np.random.Generator, flights: int) -> np.ndarray:
    return draw.standard_normal((flights, 4))


def _linear(draw: np.random.Generator, flights: int) -> tuple[np.ndarray, np.ndarray]:
    x = _normal(draw, flights)
    return x, x @ [1.0, 0.8, 0.0, -0.3] + 1.5 * draw.standard_normal(flights)


def _precise(draw: np.random.Generator, flights: int) -> tuple[np.ndarray, np.ndarray]:
    x = draw.random((flights, 4))
    return x, x @ [1.0, 0.8, 0.1, -0.3] + 0.02 * draw.standard_normal(flights)


def _exponential(draw: np.random.Generator, flights: int) -> tuple[np.ndarray, np.ndarray]:
    x = _normal(draw, flights)
    return x, np.exp(x @ [1.0, 0.5, 0.0, -0.3]) + x[:, 0] ** 3 + 0.3 * draw.standard_normal(flights)


def _unequal_spread(draw: np.random.Generator, flights: int) -> tuple[np.ndarray, np.ndarray]:
    x = 2.0 * draw.random((flights, 4)) - 1.0
    return x, x @ [1.0, 0.5, 0.0, 0.2] + (1.0 + x[:, 0]) * draw.standard_normal(flights)


def _correlated(draw: np.random.Generator, flights: int) -> tuple[np.ndarray, np.ndarray]:
    x = _normal(draw, flights)
    x[:, 1] = 0.7 * x[:, 0] + np.sqrt(1.0 - 0.7**2) * x[:, 1]
    return x, x @ [1.0, 1.0, 0.0, 0.3] + draw.standard_t(3.0, flights)


def _folded(draw: np.random.Generator, flights: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw a largest error, with distances from the medians, a switch and early terminations."""
    x = _normal(draw, flights)[:, :3]
    x[:, 2] = x[:, 2] > 1.3
    y = np.abs(x[:, 0] + 0.3 * x[:, 1]) + 0.5 * x[:, 2] + 0.4 * draw.standard_normal(flights)
    y[draw.random(flights) < 0.02] = np.inf
    return np.hstack([x, np.abs(x[:, :2])]), y


CASES = {
    "linear, half of it noise": _linear,
    "linear, nearly no noise": _precise,
    "exponential and cubic": _exponential,
    "spread grows with an input": _unequal_spread,
    "correlated inputs, heavy tails": _correlated,
    "either way, with a switch and lost flights": _folded,
}


def miss(
    case: Callable[[np.random.Generator, int], tuple[np.ndarray, np.ndarray]],
    truth: np.ndarray,
    flights: int,
    campaigns: int,
) -> np.ndarray:
    """Return the share of campaigns [input] whose interval misses the true coefficient."""
    missed = np.zeros(len(truth))
    for seed in range(campaigns):
        drivers = rank_drivers(*_pair(case(np.random.default_rng(100 + seed), flights)))
        missed += ((drivers.srrc_low > truth) | (drivers.srrc_high < truth))[:, 0]
    return missed / campaigns


def _pair(sample: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    return sample[0], sample[1][:, None]


def main() -> None:
    """Print a row for each case and number of flights."""
    campaigns, many = (2, 2000) if sys.argv[1:] == ["--smoke"] else (CAMPAIGNS, 200_000)
    for name, case in CASES.items():
        truth = rank_drivers(*_pair(case(np.random.default_rng(1), many))).srrc
        for flights in FLIGHTS:
            missed = miss(case, truth, flights, campaigns)
            print(
                f"{name}, {flights} flights: {missed.mean():.3f} together, {missed.max():.3f} "
                "worst",
                flush=True,
            )


if __name__ == "__main__":
    main()
