"""Paired comparison of two controllers on the same dispersed flights."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from abhv_mc.array_types import Floats, Ints, Mask
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.statistic import Statistic
from abhv_mc.folder.controller_flights import ControllerFlights, common_rows, distances, metric_sign
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.estimates import LEVELS, Interval, pair_differences
from abhv_mc.statistics.quantile_pairs import quantile_differences
from abhv_mc.statistics.winner import (
    RISK,
    Decision,
    PairedFailures,
    PairedMetric,
    agree,
    compare_failures,
    compare_metric,
    decide,
    median_ratio,
)
from abhv_mc.topics.formatting import level_name
from abhv_mc.topics.missed_requirements import failed_anyhow, requirement_failures

_LISTED = 10  # maximum number of listed flights that failed under only one controller


@dataclass(frozen=True, kw_only=True)
class ComparedMetric(PairedMetric):
    """Comparison of controllers `a` and `b` in one metric, with the differences `a - b`."""

    compared: bool  # whether the comparison may name a winner in this metric
    winner: str | None
    closer: str | None  # controller with the smaller value on more flights
    mixed: bool  # whether a controller has an advantage but no winner is named
    # levels of the quantiles for which controller `closer` is significantly worse
    worse_tails: tuple[float, ...]
    uncompared_tails: tuple[float, ...]
    loses_more: bool
    worst: tuple[float, float]
    quantile_differences: Mapping[str, Interval]  # differences of quantiles, by level


@dataclass(frozen=True, kw_only=True)
class ListedFailures(PairedFailures):
    """Paired failures, with the first few flights that failed under one controller only."""

    flights_only_a: tuple[int, ...]
    flights_only_b: tuple[int, ...]


@dataclass(frozen=True)
class ControllerPair:
    """Comparison of `a` with `b` in metrics, failures and control effort."""

    a: str
    b: str
    pairs: int  # number of paired flights
    metrics: Mapping[str, ComparedMetric]
    requirements: tuple[ListedFailures, ...]  # one entry per requirement, in the campaign's order
    ended_early: ListedFailures
    losing: str | None  # controller with significantly more early terminations
    surfaces: Mapping[str, Interval | None]  # median ratio a / b of each control-effort metric


@dataclass(frozen=True)
class Standing:
    """Result of the comparison of all controllers in one metric."""

    winner: str | None  # controller that is significantly better than every other controller
    # controllers than which no other controller is significantly better, sorted by name
    not_beaten: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """Comparison of all pairs of a campaign's controllers, whose names are sorted."""

    pairs: Mapping[str, ControllerPair]
    standings: Mapping[str, Standing]  # by metric in which a winner may be named


def compute_comparison(results: FlownCampaign) -> Comparison:
    """Return the comparison of all pairs of controllers in the leading metrics."""
    campaign, number = results.campaign, len(results.pairs)
    points = len(campaign.unknowns.points)
    compared = {
        f"{a} - {b}": compare_pair(
            results.flights[a],
            results.flights[b],
            (a, b),
            results.compared,
            results.compared,
            requirements=campaign.requirements,
            number=number,
            independent=campaign.judged,
            points=points,
        )
        for a, b in results.pairs
    }
    pairs = {key: pair for key, pair in compared.items() if pair}
    return Comparison(pairs, make_standings(pairs.values(), results.controllers))


def make_standings(
    pairs: Collection[ControllerPair], controllers: Sequence[str]
) -> dict[str, Standing]:
    """Return the winner and the controllers that are not beaten, by metric."""
    standings = {}
    for metric in next((pair.metrics for pair in pairs), {}):
        wins: Counter[str] = Counter()
        beaten = set()
        for pair in pairs:
            if winner := pair.metrics[metric].winner:
                wins[winner] += 1
                beaten.add(pair.b if winner == pair.a else pair.a)
        best = [name for name in controllers if wins[name] == len(controllers) - 1]
        not_beaten = tuple(sorted(set(controllers) - beaten))
        standings[metric] = Standing(best[0] if best else None, not_beaten)
    return standings


def compare_pair(
    flights_a: ControllerFlights,
    flights_b: ControllerFlights,
    names: tuple[str, str],
    metrics: Iterable[str],
    compared: Sequence[str],
    *,
    requirements: Sequence[Requirement],
    number: int = 1,
    independent: bool = True,
    points: int = 1,
) -> ControllerPair | None:
    """Return the comparison of controllers `a` and `b`; None if they share no flight.

    Winners are named only for the `compared` metrics, and only if the flights are `independent`
    draws. The significance level is corrected for the metrics and the `number` of pairs. With
    several ``points`` of the unknown parameters, a difference between the controllers must be
    significant at every point. Counts and differences include the flights at all points.
    """
    rows_a, rows_b = common_rows(flights_a, flights_b)
    if not rows_a.size:
        return None
    lost = flights_a.failed[rows_a], flights_b.failed[rows_b]
    numbers = flights_a.flight[rows_a]
    point_masks = [numbers % points == point for point in range(points)]
    ended_early = _lost_everywhere(*lost, numbers, point_masks)
    loses_more = ended_early.only_a != ended_early.only_b and ended_early.p_value <= RISK / number
    return ControllerPair(
        *names,
        pairs=rows_a.size,
        metrics={
            metric: _metric(
                distances(flights_a, metric, rows_a),
                distances(flights_b, metric, rows_b),
                names,
                lost,
                len(compared) if independent and metric in compared else 0,
                number=number,
                point_masks=point_masks,
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
        ended_early=ended_early,
        losing=names[ended_early.only_a < ended_early.only_b] if loses_more else None,
        surfaces={
            metric: median_ratio(
                flights_a.metrics[metric][rows_a], flights_b.metrics[metric][rows_b]
            )
            for metric in usage_metrics(flights_a)
            if metric in flights_b.metrics
        },
    )


def _metric(
    a: Floats,
    b: Floats,
    names: tuple[str, str],
    lost: tuple[Mask, Mask],
    compared: int,
    *,
    number: int,
    point_masks: Sequence[Mask],
    record: Metric,
) -> ComparedMetric:
    """Return the comparison of two controllers in one metric.

    A winner is named only if the number of ``compared`` metrics is positive. ``number`` is the
    number of pairs of controllers. Each mask [pair] in ``point_masks`` selects the flight pairs at
    one point of the unknown parameters.
    """
    differences = compare_metric(a, b)
    decisions = (
        [
            decide(a[k], b[k], lost[0][k], lost[1][k], compared, pairs=number)
            for k in point_masks
            if k.any()
        ]
        if compared
        else []
    )
    decision = agree(decisions) if decisions else Decision("")
    wins_at_a_point = any(point_decision.winner for point_decision in decisions)
    sense = "high" if record.band else record.bad
    sides = {"a": names[0], "b": names[1], "": None}
    worst_a, worst_b = (
        float(metric_sign(record) * np.max(side, where=np.isfinite(side), initial=-np.inf))
        for side in (a, b)
    )
    return ComparedMetric(
        **{**vars(differences), "median_difference": differences.median_difference.in_sense(sense)},
        compared=compared > 0,
        winner=sides[decision.winner],
        closer=sides[decision.closer],
        mixed=not decision.winner and (bool(decision.closer) or wins_at_a_point),
        worse_tails=decision.worse,
        uncompared_tails=decision.uncompared,
        loses_more=decision.loses_more,
        worst=(worst_a, worst_b),
        quantile_differences={
            level_name(level): interval.in_sense(sense)
            for level, interval in zip(LEVELS, quantile_differences(a, b, LEVELS), strict=True)
        },
    )


def _lost_everywhere(a: Mask, b: Mask, flight: Ints, point_masks: Sequence[Mask]) -> ListedFailures:
    """Return the paired comparison of early terminations, with the points' largest p-value.

    A point is a set of values of the unknown parameters. A point counts with a p-value of 1 if the
    difference at this point and the difference over all flights have opposite signs.
    """
    failures = _failures(a, b, flight)
    point_failures = [compare_failures(a[k], b[k]) for k in point_masks]
    p_values = [
        counts.p_value
        if (counts.only_a > counts.only_b) == (failures.only_a > failures.only_b)
        else 1.0
        for counts in point_failures
    ]
    return replace(failures, p_value=max(p_values))


def _failures(a: Mask, b: Mask, flight: Ints) -> ListedFailures:
    only_a, only_b = (tuple(flight[alone][:_LISTED].tolist()) for alone in (a & ~b, b & ~a))
    return ListedFailures(
        **vars(compare_failures(a, b)), flights_only_a=only_a, flights_only_b=only_b
    )


def compare_any_failures(
    a: ControllerFlights, b: ControllerFlights, requirements: tuple[Requirement, ...]
) -> ListedFailures:
    """Return the paired comparison of failures (early terminations or missed requirements)."""
    rows_a, rows_b = common_rows(a, b)
    failed = failed_anyhow(a, requirements)[rows_a], failed_anyhow(b, requirements)[rows_b]
    return _failures(*failed, a.flight[rows_a])


def metric_differences(a: ControllerFlights, b: ControllerFlights, metric: str) -> Floats:
    """Return the differences `a - b` of a metric [pair], in the unit of the metric.

    A difference is infinite if only one of the paired flights terminated early, and 0 if both did.
    """
    differences = pair_differences(
        *(distances(f, metric, rows) for f, rows in zip((a, b), common_rows(a, b), strict=True))
    )
    return metric_sign(a.records[metric]) * differences


def usage_metrics(flights: ControllerFlights) -> tuple[str, ...]:
    """Return the names of the rms deflections of surfaces; empty for custom simulators."""
    return tuple(
        name
        for name, record in flights.records.items()
        if record.group == "usage" and record.statistic == Statistic.RMS and name in flights.metrics
    )


def total_usage(flights: ControllerFlights) -> Floats:
    """Return the root sum square of the rms deflections of three surfaces, deg [flight]."""
    squares = np.sum([flights.metrics[name] ** 2 for name in usage_metrics(flights)], axis=0)
    return np.sqrt(squares)
