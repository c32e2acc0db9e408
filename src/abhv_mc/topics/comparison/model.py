"""One controller against another, flight by flight, on the same dispersions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Mask
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.flight.metrics import SURFACE_USAGE, Metric
from abhv_mc.folder.controller_flights import (
    ControllerFlights,
    common_rows,
    distances,
    metric_sign,
    severities,
)
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.estimates import LEVELS, Interval, pair_differences, quantile
from abhv_mc.statistics.paired import (
    PairedFailures,
    PairedUsage,
    compare_failures,
    compare_metric,
    compare_usage,
    median_ratio,
)
from abhv_mc.statistics.winner import Decision, agree, decide
from abhv_mc.topics.missed_requirements import failed_anyhow, requirement_failures
from abhv_mc.topics.plain import DRAWN, level_name

_LOST_RISK = 0.05  # of saying that one controller loses more flights where both are as good
_LISTED = 10  # flights where only one failed


@dataclass(frozen=True)
class ComparedMetric:
    """One metric of `a` against `b`; differences are `a - b`, in the metric's unit."""

    compared: bool  # whether a winner may be named
    a_better: int  # pairs
    b_better: int
    ties: int
    winner: str | None
    closer: str | None  # who is on more flights, a winner or not
    mixed: bool  # whether the closer one is no winner
    worse_tails: tuple[float, ...]  # quantiles in which the closer one is shown to be worse
    uncompared_tails: tuple[float, ...]
    loses_more: bool
    worst: tuple[float, float]
    median_difference: Interval
    pairing_gain: (
        float | None
    )  # how many times the flights an unpaired comparison of means would need
    quantile_differences: Mapping[str, Interval]  # by level
    # At how many values of the unknowns `a` and `b` are winners, and how many values there are.
    better_at: tuple[int, int, int] = field(default=(0, 0, 1), metadata={DRAWN: True})


@dataclass(frozen=True, kw_only=True)
class ListedFailures(PairedFailures):
    """Failures on the same flights, with the first flights where only one failed."""

    flights_only_a: tuple[int, ...]
    flights_only_b: tuple[int, ...]


@dataclass(frozen=True)
class ControllerPair:
    """Everything of `a` against `b`."""

    a: str
    b: str
    pairs: int  # flights
    metrics: Mapping[str, ComparedMetric]
    requirements: tuple[ListedFailures, ...]  # in the campaign's order
    ended_early: ListedFailures
    usage: Mapping[str, PairedUsage | None]  # by tracking error
    surfaces: Mapping[str, Interval | None]  # median ratio a / b of each metric of usage

    @property
    def losing(self) -> str:
        """Which side, `a` or `b`, is shown to lose more flights; '' for none."""
        lost = self.ended_early
        if lost.p_value > _LOST_RISK or lost.only_a == lost.only_b:
            return ""
        return "a" if lost.only_a > lost.only_b else "b"


@dataclass(frozen=True)
class Comparison:
    """The first controller of a campaign against each other one."""

    pairs: Mapping[str, ControllerPair]
    # By metric in which a winner is named, and controller.
    medians: Mapping[str, Mapping[str, Interval]] = field(
        default_factory=dict, metadata={DRAWN: True}
    )


def compute_comparison(results: FlownCampaign) -> Comparison:
    """Pairs of all controllers with the first."""
    campaign, rivals = results.campaign, len(list(results.pairs))
    points = len(campaign.unknowns.points)
    pairs = {
        f"{a} - {b}": compare_pair(
            results.flights[a],
            results.flights[b],
            (a, b),
            results.metrics,
            results.compared,
            requirements=campaign.requirements,
            rivals=rivals,
            independent=campaign.judged,
            points=points,
        )
        for a, b in results.pairs
    }
    medians = {
        metric: {
            name: quantile(severities(results.flights[name], metric), 0.5).in_sense(
                campaign.metrics[metric].bad
            )
            for name in results.controllers
        }
        for metric in results.compared
    }
    return Comparison({name: pair for name, pair in pairs.items() if pair}, medians)


def compare_pair(
    flights_a: ControllerFlights,
    flights_b: ControllerFlights,
    names: tuple[str, str],
    metrics: Iterable[str],
    compared: Sequence[str],
    *,
    requirements: Sequence[Requirement],
    rivals: int = 1,
    independent: bool = True,
    points: int = 1,
) -> ControllerPair | None:
    """Every metric, every requirement and the control usage of `a` against `b`; None without a common flight.

    Winners are named of the `compared` metrics, and allow for all of these and for all `rivals`; flights that are not
    `independent` draws name none. With several ``points`` of unknowns a winner, and who loses more flights, is one at
    each of them; counts and differences are of all flights.
    """
    rows_a, rows_b = common_rows(flights_a, flights_b)
    if not rows_a.size:
        return None
    rows = rivals * max(1, len(compared))
    lost = flights_a.failed[rows_a], flights_b.failed[rows_b]
    numbers = flights_a.flight[rows_a]
    at = (
        [numbers % points == point for point in range(points)]
        if points > 1
        else [np.ones(len(numbers), bool)]
    )
    return ControllerPair(
        *names,
        pairs=int(rows_a.size),
        metrics={
            metric: _metric(
                distances(flights_a, metric, rows_a),
                distances(flights_b, metric, rows_b),
                names,
                lost,
                rows if independent and metric in compared else 0,
                at=at,
                record=flights_a.records[metric],
            )
            for metric in metrics
        },
        requirements=tuple(
            _failures(
                requirement_failures(flights_a, item)[rows_a],
                requirement_failures(flights_b, item)[rows_b],
                numbers,
            )
            for item in requirements
        ),
        ended_early=_lost_everywhere(*lost, numbers, at),
        usage=_usage(flights_a, flights_b, rows_a, rows_b, compared),
        surfaces={
            metric: median_ratio(
                flights_a.metrics[metric][rows_a], flights_b.metrics[metric][rows_b]
            )
            for metric in SURFACE_USAGE
            if metric in flights_a.metrics and metric in flights_b.metrics
        },
    )


def _metric(
    a: Floats,
    b: Floats,
    names: tuple[str, str],
    lost: tuple[Mask, Mask],
    rows: int,
    *,
    at: Sequence[Mask],
    record: Metric,
) -> ComparedMetric:
    """One metric; a winner is named among so many ``rows`` that are compared, or not where they are 0; ``at``: the
    pairs of each value of the unknowns."""
    found = compare_metric(a, b)
    each = [decide(a[k], b[k], lost[0][k], lost[1][k], rows) for k in at if k.any()] if rows else []
    decision = agree(each) if each else Decision("")
    a_at, b_at = (sum(one.winner == side for one in each) for side in ("a", "b"))
    sense = "high" if record.band else record.bad
    sides = {"a": names[0], "b": names[1], "": None}
    worst_a, worst_b = (
        float(metric_sign(record) * np.max(side, where=np.isfinite(side), initial=-np.inf))
        for side in (a, b)
    )
    return ComparedMetric(
        compared=rows > 0,
        a_better=found.a_better,
        b_better=found.b_better,
        ties=found.ties,
        winner=sides[decision.winner],
        closer=sides[decision.closer],
        mixed=not decision.winner and (bool(decision.closer) or a_at + b_at > 0),
        worse_tails=decision.worse,
        uncompared_tails=decision.uncompared,
        loses_more=decision.loses_more,
        worst=(worst_a, worst_b),
        median_difference=found.median_difference.in_sense(sense),
        pairing_gain=found.pairing_gain,
        quantile_differences={
            level_name(level): interval.in_sense(sense)
            for level, interval in zip(LEVELS, found.quantile_differences, strict=True)
        },
        better_at=(a_at, b_at, max(1, len(each))),
    )


def _lost_everywhere(
    a: Mask, b: Mask, flight: NDArray[np.int64], at: Sequence[Mask]
) -> ListedFailures:
    """Lost flights; the p-value is the largest of those at each value of the unknowns, on the side that loses more."""
    found = _failures(a, b, flight)
    each = [compare_failures(a[k], b[k]) for k in at]
    more = [
        one.p_value if (one.only_a > one.only_b) == (found.only_a > found.only_b) else 1.0
        for one in each
    ]
    return replace(found, p_value=max(more))


def _failures(a: Mask, b: Mask, flight: NDArray[np.int64]) -> ListedFailures:
    only_a, only_b = (tuple(flight[alone][:_LISTED].tolist()) for alone in (a & ~b, b & ~a))
    return ListedFailures(
        **vars(compare_failures(a, b)), flights_only_a=only_a, flights_only_b=only_b
    )


def compare_any_failures(
    a: ControllerFlights, b: ControllerFlights, requirements: tuple[Requirement, ...]
) -> ListedFailures:
    """Flights that ended early or miss any requirement, under one alone and under both."""
    rows_a, rows_b = common_rows(a, b)
    failed = failed_anyhow(a, requirements)[rows_a], failed_anyhow(b, requirements)[rows_b]
    return _failures(*failed, a.flight[rows_a])


def metric_differences(a: ControllerFlights, b: ControllerFlights, metric: str) -> Floats:
    """`a` minus `b` in a metric [pair], in its unit; infinite where only one was lost, 0 where both were."""
    found = pair_differences(
        *(distances(f, metric, rows) for f, rows in zip((a, b), common_rows(a, b), strict=True))
    )
    return metric_sign(a.records[metric]) * found


def total_usage(metrics: Mapping[str, Floats]) -> Floats:
    """Root of the sum of the squared rms deflections of the three surfaces, deg [flight]."""
    squares: Floats = np.sum([metrics[name] ** 2 for name in SURFACE_USAGE], axis=0)
    return np.sqrt(squares)


def _usage(
    a: ControllerFlights,
    b: ControllerFlights,
    rows_a: NDArray[np.intp],
    rows_b: NDArray[np.intp],
    of: Sequence[str],
) -> dict[str, PairedUsage | None]:
    """Tracking errors among the metrics ``of``, each beside the usage."""
    if not set(SURFACE_USAGE) <= set(a.metrics) & set(b.metrics):
        return {}
    flown = ~(a.failed[rows_a] | b.failed[rows_b])
    use_a, use_b = total_usage(a.metrics)[rows_a][flown], total_usage(b.metrics)[rows_b][flown]
    return {
        metric: compare_usage(
            a.metrics[metric][rows_a][flown], b.metrics[metric][rows_b][flown], use_a, use_b
        )
        for metric in of
        if a.records[metric].group == "tracking"
    }
