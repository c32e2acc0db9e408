"""How bad a flight is, in one number that grows without cliffs where it can."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.flights import FlightRows
from abhv_mc.statistics.estimates import Criterion

# A flight that ends early is worse than every other; the earlier the worse, in seconds on top of this.
ENDED_EARLY = 1e9
# Above it a requirement is broken: a severity of zero, a metric just at its limit, is a failure.
FAILS_ABOVE = -float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class Severity:
    """Severity by a metric: larger is worse. Flights that could not be computed have none (not-a-number)."""

    criterion: Criterion  # the metric, which values of it are bad, and the limit of a requirement
    duration: float  # s, of a flight that does not end early
    early_is_worse: bool = True

    def of(self, rows: FlightRows) -> Floats:
        """Severities ``[flight]``."""
        excess = self.criterion.excess(rows.column(self.criterion.metric))
        severities = np.where(np.isinf(excess), ENDED_EARLY, excess)
        if self.early_is_worse:
            severities = np.where(
                ended_early(rows), ENDED_EARLY + self.duration - rows.end_time, severities
            )
        return np.where(not_computed(rows), np.nan, severities)

    def ranked(self, rows: FlightRows) -> Floats:
        """Severities ``[flight]`` with flights that could not be computed behind all others (-infinity)."""
        found = self.of(rows)
        return np.where(np.isnan(found), -np.inf, found)


def ended_early(rows: FlightRows) -> NDArray[np.bool_]:
    """Flights ``[flight]`` that ended early."""
    outcome = np.array(rows.outcome)
    return (outcome != Outcome.OK.code) & (outcome != Outcome.FAILED_TO_RUN.code)


def not_computed(rows: FlightRows) -> NDArray[np.bool_]:
    """Flights ``[flight]`` that the machine could not compute."""
    return np.array(rows.outcome) == Outcome.FAILED_TO_RUN.code


def rank_distinct(
    severities: Floats, samples: Floats, number: int, apart: float = 0.0
) -> list[int]:
    """The flights with the greatest severities, the worst first; flights with the same samples but once.

    Each lies farther than ``apart`` from all worse ones: rms over the columns of ``samples`` [flight, parameter], in
    parts of the range that they span. A failure that never comes, at infinity, is the whole range from any that does.
    """
    order = np.argsort(-severities, kind="stable")
    order = order[np.isfinite(severities[order])]
    comes = np.isfinite(samples)
    low, high = (
        samples.min(0, where=comes, initial=np.inf),
        samples.max(0, where=comes, initial=-np.inf),
    )
    span = high - low
    places = np.where(comes, samples, 0.0)[order] / np.where(span > 0.0, span, 1.0)
    comes = comes[order]
    found: list[int] = []
    while len(order) and len(found) < number:
        found.append(int(order[0]))
        distance = np.where(comes == comes[0], places - places[0], 1.0)
        others = np.sqrt(np.mean(distance**2, axis=1)) > apart
        order, places, comes = order[others], places[others], comes[others]
    return found
