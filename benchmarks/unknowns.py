"""What a PASS over unknowns promises: python benchmarks/unknowns.py [repetitions, 300]

An unknown has one value for the whole programme. A flight's severity here is a normal number that fails above 0; its
mean goes with the unknowns, and so does part of its scatter, but for plain ramps: flights that are bad at one value
need not be at another.
99.73 % at a risk of 10 %, looked at every 100 flights up to 4000. `drawn`: the unknowns are drawn for each flight,
as dispersions. `corners`: judged at the corners and the centre. `rule`: at the points of the search, too.
"""

import sys
from dataclasses import dataclass, field
from math import exp

import numpy as np
from scipy.stats import norm

from abhv_mc.statistics.evidence import log_fail_evidence, most_failures
from abhv_mc.statistics.unknowns import (
    SEARCH_FLIGHTS,
    SEARCH_QUANTILE,
    corners,
    points_flown,
    search_worst,
)

PROBABILITY, RISK = 0.9973, 0.10
Q0 = 1.0 - PROBABILITY
LOOKS = np.arange(100, 4001, 100)
MOST_PASS = np.array([most_failures(int(n), PROBABILITY, RISK) for n in LOOKS])
_COUNTS = 200  # failures; beyond, FAIL is certain
E_FAIL = np.array([[exp(min(log_fail_evidence(k, int(n), PROBABILITY), 700.0)) if k <= n else np.inf
                    for k in range(_COUNTS)] for n in LOOKS])  # fmt: skip


@dataclass
class System:
    """Mean of the severity at points [point, unknown] of a box, and how flights scatter about it."""

    words: str
    unknowns: int
    rate: float  # at the worst point, in q0
    shape: str  # ramp, bump, interaction, corners
    width: float = 0.0  # of a bump, half-boxes
    rise: float = 0.0  # of the mean, from the centre of a ramp to its worst corner; of a bump
    mixed: float = 0.5  # scatter that goes with the unknowns, beside 1 that does not
    peak: np.ndarray = field(default_factory=lambda: np.zeros(0))  # of a bump

    def mean(self, points):
        """Mean [point], -z at the worst."""
        worst = norm.ppf(self.rate * Q0)
        if self.shape == "ramp":
            return worst - self.rise * (1.0 - points.mean(axis=1))
        if self.shape == "bump":
            square = np.sum((points - self.peak) ** 2, axis=1)
            return worst - self.rise * (1.0 - np.exp(-0.5 * square / self.width**2))
        if self.shape == "interaction":
            return worst - self.rise * (
                1.0 - 0.5 * (points[:, 0] * points[:, 1] - points[:, 2] * points[:, 3])
            )
        return np.full(len(points), worst)

    def scatter(self, draw, flights):
        """What the flights are: a number of their own, and a direction in the box (or one for each corner)."""
        directions = 2**self.unknowns if self.shape == "corners" else self.unknowns
        return draw.standard_normal(flights), draw.standard_normal((flights, directions))

    def severity(self, points, flights):
        """Severity [point, flight]; its scatter has variance 1 at each point, but between the corners less."""
        own, direction = flights
        if self.shape == "corners":  # each corner has flights of its own
            weights = np.prod(0.5 * (1.0 + points[:, None, :] * corners(self.unknowns)), axis=2)
            return self.mean(points)[:, None] + weights @ direction.T
        scatter = own + self.mixed * points @ direction.T
        return (
            self.mean(points)[:, None]
            + scatter / np.sqrt(1.0 + self.mixed**2 * np.sum(points**2, axis=1))[:, None]
        )

    def drawn(self, draw, flights):
        """Severity [flight] where each flight draws its own point."""
        points = draw.uniform(-1.0, 1.0, (flights, self.unknowns))
        return self.mean(points) + draw.standard_normal(flights)

    def worst_rate(self, points):
        """Largest failure rate over points, in q0."""
        spread = 1.0
        if self.shape == "corners":
            spread = np.sqrt(
                np.sum(
                    np.prod(0.5 * (1.0 + points[:, None, :] * corners(self.unknowns)), axis=2) ** 2,
                    1,
                )
            )
        return float(np.max(norm.cdf(self.mean(points) / spread))) / Q0


def decide(failed):
    """Whether there is a PASS, and a FAIL, at any look; failed [point, flight]."""
    counts = np.cumsum(failed, axis=1)[:, LOOKS - 1]
    passed = bool(np.any(np.all(counts <= MOST_PASS, axis=0)))
    evidence = E_FAIL[np.arange(len(LOOKS)), np.minimum(counts, _COUNTS - 1)].mean(axis=0)
    return passed, bool(np.any(evidence >= 1.0 / RISK))


def points_of(system, draw):
    """Points that the search of the rule names."""
    flights = system.scatter(draw, SEARCH_FLIGHTS)

    def severity(points):
        return np.quantile(system.severity(points, flights), SEARCH_QUANTILE, axis=1)[:, None]

    return points_flown(system.unknowns, [search_worst(severity, system.unknowns, draw)])


def simulate(system, repetitions, seed=29):
    """Shares of campaigns: drawn PASS; corners PASS, FAIL; rule PASS, FAIL; and the median of the worst rate flown."""
    counts, found = np.zeros(5), []
    for repetition in range(repetitions):
        draw = np.random.default_rng([seed, repetition])
        if system.shape == "bump":
            system.peak = draw.uniform(-0.6, 0.6, system.unknowns)
        points = points_of(system, draw)
        flights = system.scatter(draw, LOOKS[-1])
        ends = np.vstack([corners(system.unknowns), np.zeros(system.unknowns)])
        drawn = decide(system.drawn(draw, LOOKS[-1])[None] > 0.0)[0]
        at_ends = decide(system.severity(ends, flights) > 0.0)
        counts += [drawn, *at_ends, *decide(system.severity(points, flights) > 0.0)]
        found.append(system.worst_rate(points))
    return counts / repetitions, float(np.median(found))


def systems():
    """Those of the table, and those by which the rule was accepted."""
    for mixed, words in ((0.0, ""), (0.5, ", mixed")):
        for rate in (3.0, 1.0, 0.2):
            for unknowns in (1, 3):
                yield System(
                    f"{unknowns} unknown, ramp{words}",
                    unknowns,
                    rate,
                    "ramp",
                    rise=0.9,
                    mixed=mixed,
                )
    for rate in (3.0, 1.0):
        for width in (0.8, 0.4):
            yield System(f"3 unknown, bump of {width}", 3, rate, "bump", width, 1.2)
    for rate in (3.0, 1.0):
        yield System("5 unknown, t1 t2 - t3 t4", 5, rate, "interaction", rise=0.8)
    yield System("3 unknown, corners differ", 3, 0.2, "corners")
    for unknowns in (5, 7):
        for width in (0.8, 0.4):
            yield System(f"{unknowns} unknown, bump of {width}", unknowns, 3.0, "bump", width, 1.2)


def main():
    """Print a line a system."""
    repetitions = int(sys.argv[1].replace("--smoke", "1")) if len(sys.argv) > 1 else 300
    print(f"{'':34}{'drawn':>8}{'corners':>16}{'rule':>16}{'worst rate':>12}")
    print(
        f"{'worst value at':>34}{'PASS':>8}{'PASS':>8}{'FAIL':>8}{'PASS':>8}{'FAIL':>8}{'flown, q0':>12}"
    )
    for system in systems():
        shares, found = simulate(system, repetitions)
        words = f"{system.words}, {system.rate:g} q0"
        print(
            f"{words:34}" + "".join(f"{share:8.3f}" for share in shares) + f"{found:12.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
