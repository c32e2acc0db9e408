"""Outcomes and findings of the flights, and the worst flights."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats, Indices
from abhv_mc.campaign.sampling.marginals import find_moments
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.statistic import Statistic
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign, flights_with_history
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.missed_requirements import failed_anyhow, requirement_failures

_LISTED = 10  # default maximum number of worst flights
_LARGEST = 3  # number of largest dispersions listed per flight


@dataclass(frozen=True)
class LargeDispersion:
    """Dispersed value, in one flight, that is far from the campaign's mean."""

    parameter: str
    value: float
    # distance from the mean, in standard deviations; None for an event such as a failure
    sigma: float | None


@dataclass(frozen=True)
class WorstFlight:
    """Flight with its worst metric and its largest dispersions."""

    flight: int
    outcome: str  # outcome code
    by: str | None  # name of the worst metric; None after an early termination
    beyond: float  # exceedance of the limit, divided by the limit
    missed: int  # number of violated requirements
    # a metric is NaN if the flight ended before the metric's time window
    metrics: Mapping[str, float]
    samples: Mapping[str, float]
    largest: tuple[LargeDispersion, ...]


def ended_words(outcome: str, missed: int, required: int) -> str:
    """Describe how a flight ended, e.g. 'sideslip limit' or 'completed; misses 2 of 5'."""
    if outcome != Outcome.OK.code:
        return outcome.replace("_", " ")
    return f"completed; misses {missed} of {required}" if missed else "completed"


def channel_of(record: Metric, channels: Collection[str], known: Mapping[str, str]) -> str | None:
    """Return the source of a metric, or the channel whose name is a prefix of its name.

    ``known`` maps names of channels that end with a unit to names without the unit.
    """
    stems = {name: known.get(name, name) for name in channels}
    if record.of in stems:
        return record.of
    alike = [
        name for word in (record.of, record.name) for name in stems if word.startswith(stems[name])
    ]
    return max(alike, key=lambda name: len(stems[name]), default=None)


_SIDES = {
    Statistic.MAX_ABS: (-1.0, 1.0),
    Statistic.MAX: (1.0,),
    Statistic.MIN: (1.0,),
    Statistic.FINAL: (1.0,),
}


def limit_sides(record: Metric, channels: Collection[str]) -> tuple[float, ...]:
    """Return the factors that convert a metric's limit to levels of its channel."""
    return _SIDES.get(record.statistic, ()) if record.of in channels else ()


def listed_worst(results: FlownCampaign, name: str) -> list[int]:
    """Return the rows of the worst flights; only flights with histories if there are any."""
    rows = results.ranking.rows_of(name)
    has_history = np.isin(
        results.flights[name].flight[rows], list(flights_with_history(results.folder, name))
    )
    return (rows[has_history] if has_history.any() else rows)[
        : results.campaign.worst or _LISTED
    ].tolist()


def rank_failed(results: FlownCampaign, controller: str) -> list[int]:
    """Return the flight numbers of failed flights, worst first."""
    flights, rows = results.flights[controller], results.ranking.rows_of(controller)
    return flights.flight[
        rows[failed_anyhow(flights, results.campaign.requirements)[rows]]
    ].tolist()


def worst_flights(results: FlownCampaign) -> dict[str, tuple[WorstFlight, ...]]:
    """Return the worst flights of each controller; flights with histories are preferred."""
    moments = moments_of(results)
    return {name: tuple(_of(results, name, moments)) for name in results.controllers}


def moments_of(results: FlownCampaign) -> dict[str, tuple[float, float]]:
    """Return mean and standard deviation of each dispersion over the flights."""
    return {key: _moments(results.samples[key]) for key in results.dispersed}


def _of(
    results: FlownCampaign, name: str, moments: Mapping[str, tuple[float, float]]
) -> list[WorstFlight]:
    criteria, flights = results.campaign.criteria, results.flights[name]
    rows = np.array(listed_worst(results, name), dtype=np.intp)
    beyond, which = results.ranking.beyond[name], results.ranking.criterion_index[name]
    numbers = flights.flight[rows]
    metrics = {metric: _counted(flights, metric, rows).tolist() for metric in results.compared}
    samples = {key: value[numbers].tolist() for key, value in results.samples.items()}
    missed = np.zeros(rows.size, dtype=np.intp)
    for item in results.campaign.requirements:
        missed += requirement_failures(flights, item)[rows]
    listed = []
    for i, row in enumerate(rows.tolist()):
        drawn = {key: values[i] for key, values in samples.items()}
        listed.append(
            WorstFlight(
                flight=int(numbers[i]),
                outcome=flights.ends.codes[int(flights.outcome[row])],
                by=None if flights.failed[row] or not criteria else criteria[which[row]].metric,
                beyond=float(beyond[row]),
                missed=int(missed[i]),
                metrics={metric: values[i] for metric, values in metrics.items()},
                samples=drawn,
                largest=_largest(drawn, moments),
            )
        )
    return listed


def _moments(column: Floats) -> tuple[float, float]:
    """Return mean and standard deviation, both infinite if any value is infinite.

    An infinite value means that the event does not occur in the flight.
    """
    is_finite = np.isfinite(column).all()
    return (float(np.mean(column)), float(np.std(column))) if is_finite else (np.inf, np.inf)


def _largest(
    samples: Mapping[str, float], spread: Mapping[str, tuple[float, float]]
) -> tuple[LargeDispersion, ...]:
    """Return the dispersions of a flight, sorted by distance from the mean, largest first.

    Events that occur only in some flights, such as failures, come first.
    """
    moved = [
        LargeDispersion(key, value, None if np.isinf(sigma) else (value - mean) / (sigma or 1.0))
        for key, (mean, sigma) in spread.items()
        if np.isfinite(value := samples[key])
    ]
    moved.sort(key=lambda item: -np.inf if item.sigma is None else -abs(item.sigma))
    return tuple(moved[:_LARGEST])


def _counted(flights: ControllerFlights, metric: str, rows: Indices) -> Floats:
    record, values = flights.records[metric], flights.metrics[metric][rows]
    nothing = flights.failed[rows] & record.settled & (values == record.empty)
    return np.where(nothing, np.nan, values)


_CYCLES = 5.0  # smallest peak-to-peak ripple in deg that counts as an oscillation


@dataclass(frozen=True)
class FlightCounts:
    """Numbers of a controller's flights by outcome."""

    flown: int
    failed: int
    not_computed: int
    outcomes: Mapping[str, int]
    failure_share: Interval


@dataclass(frozen=True)
class Findings:
    """Numbers of flights that saturated, oscillated or left the range of the tables."""

    flown: int
    # number of flights with a control surface at its deflection or rate limit; None if unknown
    saturated: int | None
    outside_tables: int | None
    cycling: Mapping[str, int]  # number of oscillating flights, by channel
    ripple_deg: float = _CYCLES


@dataclass(frozen=True)
class InputMoments:
    """Mean and standard deviation of an input, as stated and in the imported table."""

    stated_mean: float
    stated_sigma: float
    mean: float
    sigma: float


@dataclass(frozen=True)
class Flights:
    """Outcomes, findings and worst flights of all controllers."""

    parameters: tuple[str, ...]  # names of the dispersed parameters
    dispersions: Mapping[str, Mapping[str, object]]  # distributions as stated in the campaign file
    derived: Mapping[str, str]  # expressions of derived parameters
    counts: Mapping[str, FlightCounts]
    # number of requested flights of each controller that has no computed flights
    left_out: Mapping[str, int]
    findings: Mapping[str, Findings]
    worst: Mapping[str, tuple[WorstFlight, ...]]
    inputs: Mapping[str, InputMoments]  # inputs of an imported table


def compute_flights(results: FlownCampaign) -> Flights:
    """Return outcomes, findings and worst flights of all controllers."""
    names = results.controllers
    campaign = results.campaign
    counts = {}
    for name in names:
        flights = results.flights[name]
        flown, failed = flights.flight.size, int(flights.failed.sum())
        bounds = clopper_pearson(failed, flown) if campaign.independent else (np.nan, np.nan)
        share, outcomes = Interval(failed / flown, *bounds), flights.count_outcomes()
        counts[name] = FlightCounts(flown, failed, flights.not_computed, outcomes, share)
    stated = () if campaign.can_rerun else campaign.marginals.items()
    return Flights(
        parameters=results.dispersed,
        dispersions=campaign.dispersions,
        derived=dict(campaign.model.derived),
        counts=counts,
        left_out={
            name: count
            for name, ended in results.manifest.controllers.items()
            if (count := ended.outcomes.get("failed_to_run", 0)) and name not in names
        },
        findings={name: _findings(results.flights[name]) for name in names},
        worst=worst_flights(results),
        inputs={
            name: InputMoments(*find_moments(marginal), *_moments(results.samples[name]))
            for name, marginal in stated
        },
    )


def _findings(flights: ControllerFlights) -> Findings:
    def above(finding: str, limit: float) -> dict[str, int]:
        return {
            record.label.removesuffix(" ripple").lower().replace(" ", "_"): int(
                np.sum(flights.metrics[name] > limit)
            )
            for name, record in flights.records.items()
            if record.finding == finding and name in flights.metrics
        }

    return Findings(
        flights.flight.size,
        max(above("saturates", 0.0).values(), default=None),
        max(above("leaves_tables", 0.0).values(), default=None),
        above("cycles", _CYCLES),
    )
