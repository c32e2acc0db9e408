"""Survival of flights, by failure case and by time since the failure.

A flight's failure case is the set of failures sampled to occur before the end of the mission, so
each case contains the same flights for every controller. Inlet unstarts caused by the flight
condition belong to no case because they depend on the controller.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Mask
from abhv_mc.flights.failure_cases import NO_FAILURE, failure_cases, failure_times, is_failure_time
from abhv_mc.flights.metrics import MARGIN_FAULTS, MARGIN_NAMES
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.formatting import count_of, percent
from abhv_mc.topics.missed_requirements import requirement_failures, requirement_words
from abhv_mc.topics.topic import (
    Cell,
    Names,
    Picture,
    Row,
    Section,
    Table,
    Text,
    Topic,
    figures_of,
    grouped,
)


@dataclass(frozen=True)
class CaseVerdict:
    """Result for one requirement over the flights of a failure case."""

    missed: int
    status: str


@dataclass(frozen=True)
class CaseMargins:
    """Smallest gain margins in the flights of a failure case."""

    flights: int
    unstable: int
    median_db: float


@dataclass(frozen=True)
class CaseFlights:
    """Flights of a failure case under one controller."""

    flights: int
    lost: int
    lost_before: int  # number of flights that terminated early before their first failure
    survived: Interval  # share of the flights that survive, with its 95 % interval
    median_time_to_loss_s: float | None
    # verdicts by requirement text, for requirements on this controller
    requirements: Mapping[str, CaseVerdict]
    margins: CaseMargins | None  # gain margins; None unless requested


@dataclass(frozen=True)
class FailureCase:
    """Flights with the same set of failures."""

    case: str
    flights: int
    controllers: Mapping[str, CaseFlights]


@dataclass(frozen=True)
class FailureCases:
    """All failure cases: first the flights without failures, then the others by frequency."""

    cases: tuple[FailureCase, ...] = ()
    end_s: float | None = None  # end of the mission


def drawn_cases(results: FlownCampaign) -> tuple[NDArray[np.str_], Floats]:
    """Return the failure case and the time (s) of the first failure of each flight [flight].

    The time is infinite if no failure occurs.
    """
    names = [name for name in results.samples if is_failure_time(name)]
    columns = [results.samples[name] for name in names]
    if not columns:
        return np.empty(0, dtype=np.str_), np.empty(0)
    samples, end = np.column_stack(columns), float(results.reference["time"][-1])
    nothing = np.zeros(len(samples))
    first = failure_times(names, samples)
    return np.array(failure_cases(names, samples, nothing + end, nothing)), np.where(
        first < end, first, np.inf
    )


def cases_by_frequency(cases: NDArray[np.str_]) -> list[str]:
    """Return the distinct ``cases`` [flight]: NO_FAILURE, then the others by frequency."""
    counts = Counter(cases.tolist())
    return sorted(counts, key=lambda name: (name != NO_FAILURE, -counts[name], name))


def compute_failure_cases(results: FlownCampaign) -> FailureCases:
    """Return survival and verdicts for each failure case and controller."""
    cases, first = drawn_cases(results)
    if not cases.size:
        return FailureCases()
    failure_cases = []
    for case in cases_by_frequency(cases):
        inside = {name: cases[results.flights[name].flight] == case for name in results.controllers}
        flown = {
            name: _flown(results, name, case, rows, first)
            for name, rows in inside.items()
            if rows.any()
        }
        failure_cases.append(FailureCase(case, np.sum(cases == case), flown))
    return FailureCases(tuple(failure_cases), float(results.reference["time"][-1]))


def _flown(
    results: FlownCampaign, name: str, case: str, inside: Mask, first: Floats
) -> CaseFlights:
    flights, campaign = results.flights[name], results.campaign
    lost, number = flights.failed & inside, inside.sum()
    failures = lost.sum()
    bounds = clopper_pearson(failures, number) if campaign.independent else (np.nan, np.nan)
    after = flights.end_time[lost] - first[flights.flight[lost]]
    times = after[after >= 0.0]
    verdicts = {}
    for item in campaign.requirements:
        if name in item.controllers:
            missed = int(np.sum(requirement_failures(flights, item) & inside))
            status = item.judge(missed, number).status if campaign.independent else "ESTIMATE"
            verdicts[requirement_words(item, campaign.metrics)] = CaseVerdict(missed, status)
    return CaseFlights(
        flights=number,
        lost=failures,
        lost_before=int(np.sum(after < 0.0)) if case != NO_FAILURE else 0,
        survived=Interval(1.0 - failures / number, 1.0 - bounds[1], 1.0 - bounds[0]),
        median_time_to_loss_s=float(np.median(times))
        if times.size and case != NO_FAILURE
        else None,
        requirements=verdicts,
        margins=_margins(flights, inside),
    )


def _margins(flights: ControllerFlights, inside: Mask) -> CaseMargins | None:
    values = flights.metrics.get(MARGIN_NAMES[0], np.empty(0))
    has_margin = inside & np.isfinite(values) if values.size else np.zeros(0, bool)
    if not has_margin.any():
        return None
    unstable = flights.metrics[MARGIN_FAULTS[0].name][has_margin] > 0
    return CaseMargins(has_margin.sum(), unstable.sum(), float(np.median(values[has_margin])))


def failure_case_section(failure_cases: FailureCases, names: Names) -> Section | None:
    """Return the section on failure cases; None if no failure is dispersed."""
    if not failure_cases.cases:
        return None
    heads = ("Failure", "Flights", "Controller", "Survived (95 % interval)", "Terminated early",
             "Median time from the failure to the termination", "Requirements")  # fmt: skip
    return Section(
        "Failures in flight",
        (
            Text(
                "A flight survives if it completes the mission. A case contains all flights with "
                "the same set of failures before the end of the mission, which are the same "
                "flights for every controller. Each verdict uses only the flights of its case, "
                "without a correction for the number of verdicts."
            ),
            Table(
                "Survival by failure case",
                heads,
                tuple(
                    grouped(
                        [_row(names.label(name), cell) for name, cell in case.controllers.items()],
                        Cell(case.case, head=True),
                        Cell(str(case.flights)),
                    )
                    for case in failure_cases.cases
                ),
            ),
            Picture("failure_survival"),
            Picture("failure_bands"),
        ),
    )


def _row(label: str, cell: CaseFlights) -> Row:
    share, loss, margins = cell.survived, cell.median_time_to_loss_s, cell.margins
    # The bounds are NaN if the flights are not independent.
    bounds = "" if np.isnan(share.low) else f"{percent(share.low, 1)} to {percent(share.high, 1)}"
    clauses = [
        f"{words}: missed by {verdict.missed}, {verdict.status}"
        for words, verdict in cell.requirements.items()
    ]
    if margins is not None:
        unstable = count_of(margins.unstable, margins.flights)
        clauses.append(
            f"median smallest gain margin {margins.median_db:.1f} dB, unstable at some point: "
            f"{unstable}"
        )
    texts = str(cell.lost), "" if loss is None else f"{loss:.1f} s", "; ".join(clauses)
    survived = Cell(percent(share.value, 1), bounds)
    return (Cell(label, head=True), survived, *map(Cell, texts))


FAILURE_CASES = Topic(
    "failure_cases", FailureCases, compute_failure_cases, failure_case_section, figures_of(__name__)
)
