"""One controller against another, flight by flight, on the same dispersions."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.report.failures import requirement_failures
from abhv_mc.report.flights import ControllerFlights, common_rows, severities
from abhv_mc.report.metrics import HEADLINE, USAGE, words_of
from abhv_mc.report.plain import interval_in_sense, level_name, plain
from abhv_mc.report.results import Requirement, Results
from abhv_mc.statistics.bootstrap import PairedBootstrap
from abhv_mc.statistics.duel import failure_duel, median_ratio, metric_duel, usage_duel
from abhv_mc.vehicle.arrays import Floats

_LISTED = 10  # flights where only one failed


def paired_numbers(results: Results) -> dict[str, Any]:
    """The first controller of a campaign against each other one."""
    pairs: dict[str, Any] = {}
    for a, b in results.pairs:
        found = pair_numbers(
            results.flights[a], results.flights[b], (a, b), results.metrics, results.campaign.requirements
        )
        if found is not None:
            pairs[f"{a} - {b}"] = found
    return pairs


def pair_numbers(
    flights_a: ControllerFlights,
    flights_b: ControllerFlights,
    names: tuple[str, str],
    metrics: Iterable[str],
    requirements: Sequence[Requirement],
) -> dict[str, Any] | None:
    """Every metric, every requirement and the control usage of `a` against `b`; None without a common flight."""
    rows_a, rows_b = common_rows(flights_a, flights_b)
    if not rows_a.size:
        return None
    bootstrap = PairedBootstrap(rows_a.size)
    numbers = flights_a.flight[rows_a]
    return {
        "a": names[0],
        "b": names[1],
        "pairs": int(rows_a.size),
        "replicates": bootstrap.replicates,
        "metrics": {
            metric: _metric(
                severities(flights_a, metric, rows_a), severities(flights_b, metric, rows_b), metric, names, bootstrap
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
        "usage": _usage(flights_a, flights_b, rows_a, rows_b),
        "surfaces": {
            metric: plain(median_ratio(flights_a.metrics[metric][rows_a], flights_b.metrics[metric][rows_b]))
            for metric in USAGE
            if metric in flights_a.metrics and metric in flights_b.metrics
        },
    }


def _metric(a: Floats, b: Floats, metric: str, names: tuple[str, str], bootstrap: PairedBootstrap) -> dict[str, Any]:
    found = metric_duel(a, b, bootstrap)
    sense = words_of(metric).sense
    levels = zip(found.levels, found.quantile_differences, strict=True)
    return {
        **{key: getattr(found, key) for key in ("a_better", "b_better", "ties", "mixed")},
        "winner": {"a": names[0], "b": names[1], "": None}[found.winner],
        "median_difference": interval_in_sense(found.median_difference, sense),
        "pairing_gain": plain(found.pairing_gain),
        **{level_name(level): interval_in_sense(interval, sense) for level, interval in levels},
    }


def _failures(a: NDArray[np.bool_], b: NDArray[np.bool_], flight: NDArray[np.int64]) -> dict[str, Any]:
    found = plain(failure_duel(a, b))
    found["flights_only_a"] = flight[a & ~b][:_LISTED].tolist()
    found["flights_only_b"] = flight[b & ~a][:_LISTED].tolist()
    return dict(found)


def total_usage(metrics: Mapping[str, Floats]) -> Floats:
    """Root of the sum of the squared rms deflections of the three surfaces, deg [flight]."""
    squares: Floats = np.sum([metrics[name] ** 2 for name in USAGE], axis=0)
    return np.sqrt(squares)


def _usage(
    a: ControllerFlights, b: ControllerFlights, rows_a: NDArray[np.intp], rows_b: NDArray[np.intp]
) -> dict[str, Any]:
    if not {*USAGE, *HEADLINE} <= set(a.metrics) & set(b.metrics):
        return {}
    flown = ~(a.failed[rows_a] | b.failed[rows_b])
    use_a, use_b = total_usage(a.metrics)[rows_a][flown], total_usage(b.metrics)[rows_b][flown]
    return {
        metric: plain(usage_duel(a.metrics[metric][rows_a][flown], b.metrics[metric][rows_b][flown], use_a, use_b))
        for metric in HEADLINE
    }
