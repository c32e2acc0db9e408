"""The first controller of a campaign against each other one, flight by flight."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from abhv_mc.report.failures import requirement_failures
from abhv_mc.report.metrics import HEADLINE, USAGE, words_of
from abhv_mc.report.plain import interval_in_sense, level_name, plain
from abhv_mc.report.results import Floats, Results
from abhv_mc.report.severities import common_rows, severities
from abhv_mc.statistics.bootstrap import PairedBootstrap
from abhv_mc.statistics.duel import failure_duel, metric_duel, usage_duel

_LISTED = 10  # flights where only one failed


def duel_numbers(results: Results) -> dict[str, Any]:
    """Every metric, every requirement and the control usage of the first controller against each other one."""
    duels: dict[str, Any] = {}
    for a, b in results.pairs:
        flights_a, flights_b = results.flights[a], results.flights[b]
        rows_a, rows_b = common_rows(flights_a, flights_b)
        if not rows_a.size:
            continue
        bootstrap = PairedBootstrap(rows_a.size)
        metrics: dict[str, Any] = {}
        for metric in results.metrics:
            duel = metric_duel(
                severities(results, a, metric)[rows_a], severities(results, b, metric)[rows_b], bootstrap
            )
            sense = words_of(metric).sense
            metrics[metric] = {
                "a_better": duel.a_better,
                "b_better": duel.b_better,
                "ties": duel.ties,
                "winner": {"a": a, "b": b, "": None}[duel.winner],
                "median_difference": interval_in_sense(duel.median_difference, sense),
                "pairing_gain": plain(duel.pairing_gain),
                **{
                    level_name(level): interval_in_sense(interval, sense)
                    for level, interval in zip(duel.levels, duel.quantile_differences, strict=True)
                },
            }
        missed = {
            name: [requirement_failures(results, name, item) for item in results.campaign.requirements]
            for name in (a, b)
        }
        duels[f"{a} - {b}"] = {
            "a": a,
            "b": b,
            "pairs": int(rows_a.size),
            "replicates": bootstrap.replicates,
            "metrics": metrics,
            "requirements": [
                _failures(mine[rows_a], theirs[rows_b], flights_a.flight[rows_a])
                for mine, theirs in zip(missed[a], missed[b], strict=True)
            ],
            "ended_early": _failures(flights_a.failed[rows_a], flights_b.failed[rows_b], flights_a.flight[rows_a]),
            "usage": _usage(results, a, b, rows_a, rows_b),
        }
    return duels


def _failures(a: Any, b: Any, flight: Any) -> dict[str, Any]:
    found = plain(failure_duel(a, b))
    found["flights_only_a"] = flight[a & ~b][:_LISTED].tolist()
    found["flights_only_b"] = flight[b & ~a][:_LISTED].tolist()
    return dict(found)


def total_usage(metrics: Mapping[str, Floats]) -> Floats:
    """Root of the sum of the squared rms deflections of the three surfaces, deg [flight]."""
    squares: Floats = np.sum([metrics[name] ** 2 for name in USAGE], axis=0)
    return np.sqrt(squares)


def _usage(results: Results, a: str, b: str, rows_a: Any, rows_b: Any) -> dict[str, Any]:
    mine, theirs = results.flights[a], results.flights[b]
    if not {*USAGE, *HEADLINE} <= set(results.metrics):
        return {}
    use_a, use_b = total_usage(mine.metrics)[rows_a], total_usage(theirs.metrics)[rows_b]
    flown = ~(mine.failed[rows_a] | theirs.failed[rows_b])
    return {
        metric: plain(
            usage_duel(
                mine.metrics[metric][rows_a][flown],
                theirs.metrics[metric][rows_b][flown],
                use_a[flown],
                use_b[flown],
            )
        )
        for metric in HEADLINE
    }
