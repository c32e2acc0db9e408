"""Which failures each controller survives: flights by what failed in them, with the time since the failure as an axis.

A flight's case is what was drawn to fail before the mission's end, so that every controller has the same flights in
each. An unstart by the vehicle's own condition belongs to no case: it depends on the controller.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.failure_case import NO_FAILURE, failure_cases, failure_times
from abhv_mc.flight.metrics import MARGIN_FAULTS, MARGIN_NAMES
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.kernel.plant.parameter_names import FAILURE_TIMES
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import Interval
from abhv_mc.statistics.family import Pair, judge_pairs
from abhv_mc.topics.failed_flights import requirement_failures, requirement_words
from abhv_mc.topics.plain import DRAWN


@dataclass(frozen=True)
class CaseVerdict:
    """One requirement in the flights of a case."""

    missed: int
    status: str


@dataclass(frozen=True)
class CaseMargins:
    """Least gain margins of a case's flights."""

    flights: int
    unstable: int
    median_db: float


@dataclass(frozen=True)
class CaseFlights:
    """The flights of a case under one controller."""

    flights: int
    lost: int
    lost_before: int  # before anything failed
    survived: Interval  # share, 95 %
    median_time_to_loss_s: float | None
    requirements: Mapping[str, CaseVerdict]  # by their words, those that bind the controller
    margins: CaseMargins | None  # where they were asked for


@dataclass(frozen=True)
class FailureCase:
    """Flights in which the same failed."""

    case: str
    flights: int
    controllers: Mapping[str, CaseFlights]


@dataclass(frozen=True)
class FailureCases:
    """All cases, no failure first, then the most frequent; none where no failure is dispersed."""

    cases: tuple[FailureCase, ...] = ()
    end_s: float | None = None  # of the mission
    source: FlownCampaign | None = field(default=None, repr=False, metadata={DRAWN: True})


def drawn_cases(results: FlownCampaign) -> tuple[NDArray[np.str_], Floats]:
    """Case and time of the first failure (s, infinite without one) of every flight [flight] in the samples."""
    names = [name for name in results.samples if name in FAILURE_TIMES]
    columns = [results.samples[name] for name in names]
    if not columns:
        return np.empty(0, dtype=np.str_), np.empty(0)
    samples, end = np.column_stack(columns), float(results.reference["time"][-1])
    nothing = np.zeros(len(samples))
    first = failure_times(names, samples)
    return np.array(failure_cases(names, samples, nothing + end, nothing)), np.where(first < end, first, np.inf)


def cases_by_frequency(cases: NDArray[np.str_]) -> list[str]:
    """The names of the cases of all flights [flight]."""
    names, counts = np.unique(cases, return_counts=True)
    order = sorted(zip(names.tolist(), counts.tolist(), strict=True), key=lambda pair: (-pair[1], pair[0]))
    return [name for name, _ in sorted(order, key=lambda pair: pair[0] != NO_FAILURE)]


def compute_failure_cases(results: FlownCampaign) -> FailureCases:
    """Survivors and verdicts of each case and controller."""
    cases, first = drawn_cases(results)
    if not cases.size:
        return FailureCases()
    found = []
    for case in cases_by_frequency(cases):
        inside = {name: cases[results.flights[name].flight] == case for name in results.controllers}
        flown = {name: _flown(results, name, case, rows, first) for name, rows in inside.items() if rows.any()}
        found.append(FailureCase(case, int(np.sum(cases == case)), flown))
    return FailureCases(tuple(found), float(results.reference["time"][-1]), results)


def _flown(results: FlownCampaign, name: str, case: str, inside: NDArray[np.bool_], first: Floats) -> CaseFlights:
    flights, campaign = results.flights[name], results.campaign
    lost, number = flights.failed & inside, int(inside.sum())
    failures = int(lost.sum())
    bounds = clopper_pearson(failures, number) if campaign.independent else (np.nan, np.nan)
    after = flights.end_time[lost] - first[flights.flight[lost]]
    times = after[after >= 0.0]
    verdicts = {}
    for item in campaign.requirements:
        if name in item.controllers:
            missed = int(np.sum(requirement_failures(flights, item) & inside))
            pair = Pair(missed, number, 0, item.probability, item.consumer_risk, item.producer_risk)
            status = judge_pairs([pair], campaign.independent)[0].status
            verdicts[requirement_words(item, campaign.metrics)] = CaseVerdict(missed, status)
    return CaseFlights(
        flights=number,
        lost=failures,
        lost_before=int(np.sum(after < 0.0)) if case != NO_FAILURE else 0,
        survived=Interval(1.0 - failures / number, 1.0 - bounds[1], 1.0 - bounds[0]),
        median_time_to_loss_s=float(np.median(times)) if times.size and case != NO_FAILURE else None,
        requirements=verdicts,
        margins=_margins(flights, inside),
    )


def _margins(flights: ControllerFlights, inside: NDArray[np.bool_]) -> CaseMargins | None:
    values = flights.metrics.get(MARGIN_NAMES[0], np.empty(0))
    known = inside & np.isfinite(values) if values.size else np.zeros(0, bool)
    if not known.any():
        return None
    unstable = flights.metrics[MARGIN_FAULTS[0].name][known] > 0
    return CaseMargins(int(known.sum()), int(unstable.sum()), float(np.median(values[known])))
