"""How often intervals of rank regression coefficients miss the truth: python benchmarks/driver_intervals.py [--smoke]

The truth of a case is the coefficient of 200,000 flights. Printed are the shares of campaigns whose interval misses it,
for all inputs of a case together and for the worst one.
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
    """A largest error, with distances from the medians as inputs, a switch, and lost flights."""
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
    flights: int,
    campaigns: int,
) -> np.ndarray:
    """Share of campaigns whose interval misses the truth [input]."""
    truth = rank_drivers(*_pair(case(np.random.default_rng(1), 200_000)))
    missed = np.zeros(len(truth.srrc))
    for seed in range(campaigns):
        found = rank_drivers(*_pair(case(np.random.default_rng(100 + seed), flights)))
        missed += ((found.srrc_low > truth.srrc) | (found.srrc_high < truth.srrc))[:, 0]
    return missed / campaigns


def _pair(flown: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    return flown[0], flown[1][:, None]


def main() -> None:
    """Print a row of each case and number of flights."""
    campaigns = 2 if sys.argv[1:] == ["--smoke"] else CAMPAIGNS
    for name, case in CASES.items():
        for flights in FLIGHTS:
            missed = miss(case, flights, campaigns)
            print(
                f"{name}, {flights} flights: {missed.mean():.3f} together, {missed.max():.3f} worst",
                flush=True,
            )


if __name__ == "__main__":
    main()
