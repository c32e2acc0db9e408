"""Severity of a flight: a number that is larger for worse flights, continuous if possible."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flights import FlightRows
from abhv_mc.statistics.estimates import Criterion

# Severity of an early termination, to which the missing flight time (s) is added.
ENDED_EARLY = 1e9
# A flight fails if its severity exceeds this value; a flight exactly at a limit (severity 0) fails.
FAILS_ABOVE = -float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class Severity:
    """Severity of flights by one metric: larger is worse; NaN if a flight failed to run."""

    # metric, undesired direction, and limits of a requirement
    criterion: Criterion
    duration: float  # duration in s of a flight that does not terminate early
    early_is_worse: bool = True

    def of(self, rows: FlightRows) -> Floats:
        """Return severities [flight]."""
        excess = self.criterion.excess(rows.column(self.criterion.metric))
        severities = np.where(np.isinf(excess), ENDED_EARLY, excess)
        if self.early_is_worse:
            severities = np.where(
                ended_early(rows), ENDED_EARLY + self.duration - rows.end_time, severities
            )
        return np.where(not_computed(rows), np.nan, severities)

    def ranked(self, rows: FlightRows) -> Floats:
        """Return severities [flight], with -infinity for flights that failed to run."""
        severities = self.of(rows)
        return np.where(np.isnan(severities), -np.inf, severities)


def ended_early(rows: FlightRows) -> NDArray[np.bool_]:
    """Return a mask [flight] of flights that terminated early."""
    outcome = np.array(rows.outcome)
    return (outcome != Outcome.OK.code) & (outcome != Outcome.FAILED_TO_RUN.code)


def not_computed(rows: FlightRows) -> NDArray[np.bool_]:
    """Return a mask [flight] of flights that failed to run."""
    return np.array(rows.outcome) == Outcome.FAILED_TO_RUN.code


def rank_distinct(
    severities: Floats, samples: Floats, number: int, min_distance: float = 0.0
) -> list[int]:
    """Return the flights with the largest severities and distinct samples, worst first.

    Each flight is farther than `min_distance` from all worse returned flights (rms over the columns
    of `samples` [flight, parameter], scaled by their range). An infinite value, such as the time of
    a failure that does not occur, is one range away from any finite value.
    """
    order = np.argsort(-severities, kind="stable")
    order = order[np.isfinite(severities[order])]
    comes = np.isfinite(samples)
    low, high = (
        samples.min(0, where=comes, initial=np.inf),
        samples.max(0, where=comes, initial=-np.inf),
    )
    span = high - low
    scaled = np.where(comes, samples, 0.0)[order] / np.where(span > 0.0, span, 1.0)
    comes = comes[order]
    flights: list[int] = []
    while len(order) and len(flights) < number:
        flights.append(int(order[0]))
        distance = np.where(comes == comes[0], scaled - scaled[0], 1.0)
        is_distinct = np.sqrt(np.mean(distance**2, axis=1)) > min_distance
        order, scaled, comes = order[is_distinct], scaled[is_distinct], comes[is_distinct]
    return flights
