"""What each flight did: how they ended, what a board has to know of them, and the worst of them with what they drew."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.marginals import find_moments
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.metrics import Metric
from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign, kept_flights
from abhv_mc.kernel.flight.counting import Statistic
from abhv_mc.plant.parameters import DISTURBANCES
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.missed_requirements import failed_anyhow, requirement_failures

_LISTED = 10  # at most, where no number of worst flights keeps its histories
_LARGEST = 3  # dispersions of a flight that are told


@dataclass(frozen=True)
class LargeDispersion:
    """One of the dispersions of a flight that are furthest from the campaign's mean."""

    parameter: str
    value: float
    sigma: (
        float | None
    )  # distance in its standard deviations; None of what only some flights have, such as a failure


@dataclass(frozen=True)
class WorstFlight:
    """A flight, what it was worst in and its dispersions."""

    flight: int
    outcome: str  # its code
    by: str | None  # metric; None where it ended early
    beyond: float  # distance beyond the limit, in units of it
    missed: int  # requirements
    metrics: Mapping[
        str, float
    ]  # not-a-number where it was lost before the stretches that a metric counts
    samples: Mapping[str, float]
    largest: tuple[LargeDispersion, ...]


def ended_words(outcome: str, missed: int, required: int) -> str:
    """Return how a flight ended: 'sideslip limit', 'completed; misses 2 of 5'."""
    if outcome != Outcome.OK.code:
        return outcome.replace("_", " ")
    return f"completed; misses {missed} of {required}" if missed else "completed"


def channel_of(record: Metric, channels: Collection[str]) -> str | None:
    """Return the channel that shows a metric: the one it is counted of, or one whose name it begins with."""
    stems = {
        name: (name.rpartition("_")[0] if name in CHANNEL_INDEX else name) for name in channels
    }
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
    """Return the factors that turn a metric's limit into levels of its channel; none if they differ in kind."""
    return _SIDES.get(record.statistic, ()) if record.of in channels else ()


def listed_worst(results: FlownCampaign, name: str) -> list[int]:
    """The rows [flight] that a report lists, the worst first: those whose histories are kept, where any are."""
    rows = results.ranking.rows_of(name)
    kept = np.isin(results.flights[name].flight[rows], list(kept_flights(results.folder, name)))
    return (rows[kept] if kept.any() else rows)[: results.campaign.worst or _LISTED].tolist()


def rank_failed(results: FlownCampaign, controller: str) -> list[int]:
    """Numbers of the flights that ended early or missed a requirement, the worst first."""
    flights, rows = results.flights[controller], results.ranking.rows_of(controller)
    return flights.flight[
        rows[failed_anyhow(flights, results.campaign.requirements)[rows]]
    ].tolist()


def worst_flights(results: FlownCampaign) -> dict[str, tuple[WorstFlight, ...]]:
    """The worst flights of each controller, those whose histories are kept, with what they were worst in."""
    moments = moments_of(results)
    return {name: tuple(_of(results, name, moments)) for name in results.controllers}


def moments_of(results: FlownCampaign) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of each dispersion over the flights."""
    return {key: _moments(results.samples[key]) for key in results.dispersed}


def _of(
    results: FlownCampaign, name: str, moments: Mapping[str, tuple[float, float]]
) -> list[WorstFlight]:
    criteria, flights = results.campaign.criteria, results.flights[name]
    rows = np.array(listed_worst(results, name), dtype=np.intp)
    beyond, which = results.ranking.beyond[name], results.ranking.by[name]
    numbers = flights.flight[rows]
    metrics = {metric: _counted(flights, metric, rows).tolist() for metric in results.compared}
    samples = {key: value[numbers].tolist() for key, value in results.samples.items()}
    missed = np.zeros(rows.size, dtype=np.intp)
    for item in results.campaign.requirements:
        missed += requirement_failures(flights, item)[rows]
    found = []
    for i, row in enumerate(rows.tolist()):
        drawn = {key: values[i] for key, values in samples.items()}
        found.append(
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
    return found


def _moments(column: Floats) -> tuple[float, float]:
    """Mean and standard deviation; both infinite where some flights have an infinite value: it never comes to them."""
    return (
        (float(np.mean(column)), float(np.std(column)))
        if np.isfinite(column).all()
        else (np.inf, np.inf)
    )


def _sigmas(value: float, mean: float, sigma: float) -> float | None:
    return None if np.isinf(sigma) else (value - mean) / sigma if sigma > 0.0 else 0.0


def _largest(
    samples: Mapping[str, float], spread: Mapping[str, tuple[float, float]]
) -> tuple[LargeDispersion, ...]:
    """The dispersions furthest from the campaign's mean, furthest first; before them what only some flights have."""
    moved = [
        LargeDispersion(key, samples[key], _sigmas(samples[key], *spread[key]))
        for key in spread
        if np.isfinite(samples[key])
    ]
    return tuple(
        sorted(moved, key=lambda each: -np.inf if each.sigma is None else -abs(each.sigma))[
            :_LARGEST
        ]
    )


def _counted(flights: ControllerFlights, metric: str, rows: NDArray[np.intp]) -> Floats:
    record, values = flights.records[metric], flights.metrics[metric][rows]
    nothing = flights.failed[rows] & record.settled & (values == record.empty)
    return np.where(nothing, np.nan, values)


_CYCLES = 5.0  # deg, from side to side: ripple from which a flight is said to cycle
_LIMITS = {
    "saturates": 0.0,
    "leaves_tables": 0.0,
    "cycles": _CYCLES,
}  # of a record's finding: what is more is said


@dataclass(frozen=True)
class FlightCounts:
    """How the flights of a controller ended."""

    flown: int
    failed: int
    not_computed: int
    outcomes: Mapping[str, int]
    failure_share: Interval


@dataclass(frozen=True)
class Findings:
    """How many flights of a controller show what a board has to know beside their errors."""

    flown: int
    saturated: int | None  # surfaces at a limit of deflection or rate; None where no flight says
    outside_tables: int | None
    cycling: Mapping[str, int]  # by channel
    disturbed: (
        bool  # whether gusts, turbulence or noise are dispersed: what swings then is no limit cycle
    )
    ripple_deg: float = _CYCLES


@dataclass(frozen=True)
class InputMoments:
    """Mean and standard deviation of a dispersed input, as the campaign states them and as a table has them."""

    stated_mean: float
    stated_sigma: float
    mean: float
    sigma: float


@dataclass(frozen=True)
class Flights:
    """The flights of each controller."""

    parameters: tuple[str, ...]  # that were dispersed
    dispersions: Mapping[str, Mapping[str, object]]  # as the campaign writes them
    derived: Mapping[str, str]  # parameters that follow from others: their expressions
    counts: Mapping[str, FlightCounts]
    left_out: Mapping[
        str, int
    ]  # controllers of which the machine computed none, with their flights
    findings: Mapping[str, Findings]
    worst: Mapping[str, tuple[WorstFlight, ...]]
    inputs: Mapping[str, InputMoments]  # of a table that was imported


def compute_flights(results: FlownCampaign) -> Flights:
    """Everything of all controllers."""
    names = results.controllers
    disturbed = not set(DISTURBANCES).isdisjoint(results.campaign.varied)
    campaign = results.campaign
    stated = () if campaign.can_rerun else campaign.marginals.items()
    return Flights(
        parameters=results.dispersed,
        dispersions=campaign.dispersions,
        derived=dict(campaign.model.derived),
        counts={name: _counts(results.flights[name], campaign.independent) for name in names},
        left_out=_left_out(results),
        findings={name: _findings(results.flights[name], disturbed) for name in names},
        worst=worst_flights(results),
        inputs={
            name: InputMoments(*find_moments(marginal), *_moments(results.samples[name]))
            for name, marginal in stated
        },
    )


def _counts(flights: ControllerFlights, independent: bool) -> FlightCounts:
    flown, failed = int(flights.flight.size), int(flights.failed.sum())
    share = Interval(
        failed / flown, *(clopper_pearson(failed, flown) if independent else (np.nan, np.nan))
    )
    return FlightCounts(flown, failed, flights.not_computed, flights.count_outcomes(), share)


def _left_out(results: FlownCampaign) -> dict[str, int]:
    listed = results.manifest.controllers.items()
    lost = {name: ended.outcomes.get("failed_to_run", 0) for name, ended in listed}
    return {
        name: count for name, count in lost.items() if count and name not in results.controllers
    }


def _findings(flights: ControllerFlights, disturbed: bool) -> Findings:
    records = {
        name: record
        for name, record in flights.records.items()
        if record.finding and name in flights.metrics
    }

    def above(finding: str) -> dict[str, int]:
        return {
            record.label.removesuffix(" ripple").lower().replace(" ", "_"): int(
                np.sum(flights.metrics[name] > _LIMITS[finding])
            )
            for name, record in records.items()
            if record.finding == finding
        }

    return Findings(
        int(flights.flight.size),
        max(above("saturates").values(), default=None),
        max(above("leaves_tables").values(), default=None),
        above("cycles"),
        disturbed,
    )
