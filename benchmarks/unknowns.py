"""Error rates of PASS with unknown parameters: python benchmarks/unknowns.py [repetitions, 300]

An unknown has one value for the whole programme. The severity of a flight is a normal number and
fails above 0. The mean of the severity depends on the unknowns. Except for plain ramps, a part of
the scatter also depends on them, so that different flights are bad at different values. In the case
`spread`, the value with the largest 95 % quantile never fails, and another value fails 5.5 times
too often. In the case `wide`, a region fails because of its scatter, although all other values have
a larger quantile.

Requirements are 99.73 % at a risk of 10 %, judged every 100 flights up to 4000. In the column
`drawn`, the unknowns are drawn for each flight, like dispersions. Campaigns are judged at the
corners and the centre in `corners`, at the points that the search ranks worst by a quantile in
`ranked`, and also at the point where the search had the most failures in `rule`.
"""

import sys
from dataclasses import dataclass, field
from math import exp

import numpy as np
from scipy.special import ndtr, ndtri

from abhv_mc.statistics.evidence import log_fail_evidence, most_failures
from abhv_mc.statistics.unknowns import (
    SEARCH_FLIGHTS,
    SEARCH_QUANTILE,
    Trial,
    choose_points,
    corners,
    search_worst,
)

PROBABILITY, RISK = 0.9973, 0.10
Q0 = 1.0 - PROBABILITY
LOOKS = np.arange(100, 4001, 100)
MOST_PASS = np.array([most_failures(int(n), PROBABILITY, RISK) for n in LOOKS])
WIDE = 3.0  # standard deviation in a wide region
OUTSIDE = 0.05  # failure rate elsewhere, q0
_COUNTS = 200  # failures; beyond, FAIL is certain
E_FAIL = np.array([[exp(min(log_fail_evidence(k, int(n), PROBABILITY), 700.0)) if k <= n else np.inf
                    for k in range(_COUNTS)] for n in LOOKS])  # fmt: skip


@dataclass
class System:
    """Mean of the severity at points [point, unknown] of a box, and the scatter of flights."""

    label: str
    unknowns: int
    rate: float  # at the worst point, in q0
    shape: str  # ramp, bump, interaction, corners, spread, wide
    width: float = 0.0  # of a bump, half-boxes; where a wide region begins
    rise: float = 0.0  # of the mean, from the centre of a ramp to its worst corner; of a bump
    mixed: float = 0.5  # scatter that depends on the unknowns; the other scatter is 1
    peak: np.ndarray = field(default_factory=lambda: np.zeros(0))  # of a bump
    sides: int = 0  # unknowns that bound a wide region

    def mean(self, points):
        """Return the mean [point], -z at the worst point."""
        worst = ndtri(self.rate * Q0)
        if self.shape == "ramp":
            return worst - self.rise * (1.0 - points.mean(axis=1))
        if self.shape == "bump":
            square = np.sum((points - self.peak) ** 2, axis=1)
            return worst - self.rise * (1.0 - np.exp(-0.5 * square / self.width**2))
        if self.shape == "interaction":
            return worst - self.rise * (
                1.0 - 0.5 * (points[:, 0] * points[:, 1] - points[:, 2] * points[:, 3])
            )
        if self.shape == "spread":
            return 1.2 * points[:, 1:].mean(axis=1) - 1.25 * points[:, 0] - 3.65
        if self.shape == "wide":
            return np.where(self._inside(points), WIDE * worst, ndtri(OUTSIDE * Q0))
        return np.full(len(points), worst)

    def scale(self, points):
        """Return the standard deviation [point]."""
        if self.shape == "corners":
            return np.sqrt(np.sum(self._weights(points) ** 2, axis=1))
        if self.shape == "spread":
            return 1.0 + 0.7 * points[:, 0]
        return np.where(self._inside(points), WIDE, 1.0)

    def _inside(self, points):
        return (points[:, : self.sides] > self.width).all(axis=1) & (self.sides > 0)

    def _weights(self, points):
        return np.prod(0.5 * (1.0 + points[:, None, :] * corners(self.unknowns)), axis=2)

    def scatter(self, draw, flights):
        """Draw the flights: a number, and a direction in the box or a number for each corner."""
        directions = 2**self.unknowns if self.shape == "corners" else self.unknowns
        return draw.standard_normal(flights), draw.standard_normal((flights, directions))

    def _noise(self, points, flights):
        """Return noise [point, flight] and its factor [point] in the severity."""
        own, direction = flights
        scale = self.scale(points)
        if self.shape == "corners":  # the flights of each corner are independent
            return self._weights(points) @ direction.T, np.ones(len(points))
        if self.mixed == 0.0:
            return np.broadcast_to(own, (len(points), len(own))), scale
        noise = self.mixed * points @ direction.T
        noise += own
        return noise, scale / np.sqrt(1.0 + self.mixed**2 * np.sum(points**2, axis=1))

    def severity(self, points, flights):
        """Return the severity [point, flight]."""
        noise, scale = self._noise(points, flights)
        return self.mean(points)[:, None] + scale[:, None] * noise

    def failed(self, points, flights):
        """Return which flights fail [point, flight]."""
        noise, scale = self._noise(points, flights)
        return noise > (-self.mean(points) / scale)[:, None]

    def drawn(self, draw, flights):
        """Return the severity [flight] if each flight draws a point."""
        points = draw.uniform(-1.0, 1.0, (flights, self.unknowns))
        return self.mean(points) + self.scale(points) * draw.standard_normal(flights)

    def worst_rate(self, points):
        """Return the largest failure rate over points, in q0."""
        return float(np.max(ndtr(self.mean(points) / self.scale(points)))) / Q0


def decide(failed):
    """Return whether there is a PASS, and a FAIL, at any time; ``failed`` is [point, flight]."""
    between = np.add.reduceat(failed, np.append(0, LOOKS[:-1]), axis=1, dtype=np.int32)
    counts = np.cumsum(between, axis=1)
    passed = bool(np.any(np.all(counts <= MOST_PASS, axis=0)))
    evidence = E_FAIL[np.arange(len(LOOKS)), np.minimum(counts, _COUNTS - 1)].mean(axis=0)
    return passed, bool(np.any(evidence >= 1.0 / RISK))


def judged_points(system, draw):
    """Return the points that the search selects, and the number selected by the quantile."""
    flights = system.scatter(draw, SEARCH_FLIGHTS)

    def evaluate(points):
        ordered = np.sort(system.severity(points, flights), axis=1)[:, :, None]
        quantile = ordered[:, int(np.ceil(SEARCH_QUANTILE * (SEARCH_FLIGHTS - 1)))]
        return Trial(quantile, np.sum(ordered > 0.0, axis=1), ordered[:, -1])

    chosen = choose_points(system.unknowns, [search_worst(evaluate, system.unknowns, draw)])
    return chosen.points, chosen.shared


COLUMNS = (
    "drawn PASS", "corners PASS", "corners FAIL", "ranked PASS", "rule PASS", "rule FAIL"
)  # fmt: skip


def simulate(system, repetitions, seed=29):
    """Return shares of campaigns by column, and the median worst rate at the judged points."""
    counts, rates = np.zeros(len(COLUMNS)), []
    for repetition in range(repetitions):
        draw = np.random.default_rng([seed, repetition])
        if system.shape == "bump":
            system.peak = draw.uniform(-0.6, 0.6, system.unknowns)
        points, ranked = judged_points(system, draw)
        flights = system.scatter(draw, LOOKS[-1])
        ends = np.vstack([corners(system.unknowns), np.zeros(system.unknowns)])
        drawn = decide(system.drawn(draw, LOOKS[-1])[None] > 0.0)[0]
        at_ends = decide(system.failed(ends, flights))
        failed = system.failed(points, flights)
        counts += [drawn, *at_ends, decide(failed[:ranked])[0], *decide(failed)]
        rates.append(system.worst_rate(points))
    return dict(zip(COLUMNS, counts / repetitions, strict=True)), float(np.median(rates))


def systems():
    """Yield the systems of the table on the page, and those used to accept the rule."""
    for mixed, label in ((0.0, ""), (0.5, ", mixed")):
        for rate in (3.0, 1.0, 0.2):
            for unknowns in (1, 3, *((5,) if rate == 0.2 else ())):
                ramp_label = f"{unknowns} unknown, ramp{label}"
                yield System(ramp_label, unknowns, rate, "ramp", rise=0.9, mixed=mixed)
    for rate in (3.0, 1.0):
        for width in (0.8, 0.4):
            yield System(f"3 unknown, bump of {width}", 3, rate, "bump", width, 1.2)
    for rate in (3.0, 1.0):
        yield System("5 unknown, t1 t2 - t3 t4", 5, rate, "interaction", rise=0.8)
    yield System("3 unknown, corners differ", 3, 0.2, "corners")
    yield System("5 unknown, corners differ", 5, 0.2, "corners")
    for unknowns in (5, 7):
        for width in (0.8, 0.4):
            yield System(f"{unknowns} unknown, bump of {width}", unknowns, 3.0, "bump", width, 1.2)
    yield System("5 unknown, spread", 5, 5.5, "spread", mixed=0.0)
    for unknowns in (5, 7):
        for sides in (1, 2):
            label = f"{unknowns} unknown, wide in 1 of {2**sides}"
            yield System(label, unknowns, 3.0, "wide", 0.5, sides=sides)
        for rate in (3.0, 15.0):
            label = f"{unknowns} unknown, wide at a corner"
            yield System(label, unknowns, rate, "wide", 0.7, sides=unknowns)


def main():
    """Print a line for each system."""
    repetitions = int(sys.argv[1].replace("--smoke", "1")) if len(sys.argv) > 1 else 300
    print(f"{'':40}" + "".join(f"{prefix:>9}" for name in COLUMNS for prefix in [name.split()[0]]))
    print(
        f"{'worst value at':>40}"
        + "".join(f"{name.split()[1]:>9}" for name in COLUMNS)
        + f"{'judged, q0':>12}"
    )
    for system in systems():
        shares, rate = simulate(system, repetitions)
        label = f"{system.label}, {system.rate:g} q0"
        cells = "".join(f"{share:9.3f}" for share in shares.values())
        print(f"{label:40}{cells}{rate:12.2f}", flush=True)


if __name__ == "__main__":
    main()
