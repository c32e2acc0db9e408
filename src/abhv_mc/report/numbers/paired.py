"""One controller against another, flight by flight, on the same dispersions."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.flight.metrics import SURFACE_USAGE, Metric
from abhv_mc.folder.controller_flights import ControllerFlights, common_rows, distances
from abhv_mc.folder.results import Results
from abhv_mc.statistics.estimates import LEVELS, pair_differences
from abhv_mc.statistics.paired import compare_failures, compare_metric, compare_usage, median_ratio
from abhv_mc.statistics.winner import Decision, decide
from abhv_mc.topics.failed_flights import failed_anyhow, requirement_failures
from abhv_mc.topics.plain import interval_in_sense, level_name, plain

_LISTED = 10  # flights where only one failed


def paired_numbers(results: Results) -> dict[str, Any]:
    """The first controller of a campaign against each other one."""
    pairs: dict[str, Any] = {}
    for a, b in results.pairs:
        found = pair_numbers(
            results.flights[a],
            results.flights[b],
            (a, b),
            results.metrics,
            results.compared,
            results.campaign.requirements,
            rivals=len(list(results.pairs)),
            independent=results.campaign.independent,
        )
        if found is not None:
            pairs[f"{a} - {b}"] = found
    return pairs


def pair_numbers(
    flights_a: ControllerFlights,
    flights_b: ControllerFlights,
    names: tuple[str, str],
    metrics: Iterable[str],
    compared: Sequence[str],
    requirements: Sequence[Requirement],
    rivals: int = 1,
    independent: bool = True,
) -> dict[str, Any] | None:
    """Every metric, every requirement and the control usage of `a` against `b`; None without a common flight.

    Winners are named of the `compared` metrics, and allow for all of these and for all `rivals`; flights that are not
    `independent` draws name none.
    """
    rows_a, rows_b = common_rows(flights_a, flights_b)
    if not rows_a.size:
        return None
    metrics = list(metrics)
    rows = rivals * max(1, len(compared))
    errors = [name for name in compared if flights_a.records[name].group == "tracking"]
    lost = flights_a.failed[rows_a], flights_b.failed[rows_b]
    numbers = flights_a.flight[rows_a]
    return {
        "a": names[0],
        "b": names[1],
        "pairs": int(rows_a.size),
        "metrics": {
            metric: _metric(
                distances(flights_a, metric, rows_a),
                distances(flights_b, metric, rows_b),
                names,
                lost,
                rows if independent and metric in compared else 0,
                flights_a.records[metric],
            )
            for metric in metrics
        },
        "requirements": [
            _failures(
                requirement_failures(flights_a, item)[rows_a], requirement_failures(flights_b, item)[rows_b], numbers
            )
            for item in requirements
        ],
        "ended_early": _failures(flights_a.failed[rows_a], flights_b.failed[rows_b], numbers),
        "usage": _usage(flights_a, flights_b, rows_a, rows_b, errors),
        "surfaces": {
            metric: plain(median_ratio(flights_a.metrics[metric][rows_a], flights_b.metrics[metric][rows_b]))
            for metric in SURFACE_USAGE
            if metric in flights_a.metrics and metric in flights_b.metrics
        },
    }


def _metric(
    a: Floats,
    b: Floats,
    names: tuple[str, str],
    lost: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    rows: int,
    record: Metric,
) -> dict[str, Any]:
    """One metric; a winner is named among so many ``rows`` that are compared, or not where they are 0."""
    found = compare_metric(a, b)
    decision = decide(a, b, *lost, rows) if rows else Decision("")
    sense = "high" if record.band else record.bad
    levels = zip(LEVELS, found.quantile_differences, strict=True)
    return {
        "compared": rows > 0,
        "a_better": found.a_better,
        "b_better": found.b_better,
        "ties": found.ties,
        "winner": {"a": names[0], "b": names[1], "": None}[decision.winner],
        "closer": {"a": names[0], "b": names[1], "": None}[decision.closer],
        "mixed": bool(decision.closer) and not decision.winner,
        "worse_tails": list(decision.worse),
        "uncompared_tails": list(decision.uncompared),
        "loses_more": decision.loses_more,
        "worst": plain(
            [metric_sign(record) * np.max(side, where=np.isfinite(side), initial=-np.inf) for side in (a, b)]
        ),
        "median_difference": interval_in_sense(found.median_difference, sense),
        "pairing_gain": plain(found.pairing_gain),
        **{level_name(level): interval_in_sense(interval, sense) for level, interval in levels},
    }


def _failures(a: NDArray[np.bool_], b: NDArray[np.bool_], flight: NDArray[np.int64]) -> dict[str, Any]:
    found = plain(compare_failures(a, b))
    found["flights_only_a"] = flight[a & ~b][:_LISTED].tolist()
    found["flights_only_b"] = flight[b & ~a][:_LISTED].tolist()
    return dict(found)


def compare_any_failures(
    a: ControllerFlights, b: ControllerFlights, requirements: tuple[Requirement, ...]
) -> dict[str, Any]:
    """Flights that ended early or miss any requirement, under one alone and under both."""
    rows_a, rows_b = common_rows(a, b)
    failed = failed_anyhow(a, requirements)[rows_a], failed_anyhow(b, requirements)[rows_b]
    return _failures(*failed, a.flight[rows_a])


def metric_differences(a: ControllerFlights, b: ControllerFlights, metric: str) -> Floats:
    """`a` minus `b` in a metric [pair], in its unit; infinite where only one was lost, 0 where both were."""
    found = pair_differences(*(distances(f, metric, rows) for f, rows in zip((a, b), common_rows(a, b), strict=True)))
    return metric_sign(a.records[metric]) * found


def metric_sign(record: Metric) -> float:
    """What turns a severity into the metric: -1 where small values are bad."""
    return -1.0 if record.bad == "low" and not record.band else 1.0


def total_usage(metrics: Mapping[str, Floats]) -> Floats:
    """Root of the sum of the squared rms deflections of the three surfaces, deg [flight]."""
    squares: Floats = np.sum([metrics[name] ** 2 for name in SURFACE_USAGE], axis=0)
    return np.sqrt(squares)


def _usage(
    a: ControllerFlights,
    b: ControllerFlights,
    rows_a: NDArray[np.intp],
    rows_b: NDArray[np.intp],
    errors: Sequence[str],
) -> dict[str, Any]:
    if not set(SURFACE_USAGE) <= set(a.metrics) & set(b.metrics):
        return {}
    flown = ~(a.failed[rows_a] | b.failed[rows_b])
    use_a, use_b = total_usage(a.metrics)[rows_a][flown], total_usage(b.metrics)[rows_b][flown]
    return {
        metric: plain(compare_usage(a.metrics[metric][rows_a][flown], b.metrics[metric][rows_b][flown], use_a, use_b))
        for metric in errors
    }
