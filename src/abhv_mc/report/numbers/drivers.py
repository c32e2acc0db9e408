"""What drives each metric and where failures live, for each controller."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.folder.controller_flights import distances
from abhv_mc.folder.results import Results
from abhv_mc.statistics.drivers import FALSE_DISCOVERY_RATE, rank_drivers
from abhv_mc.statistics.failure_drivers import FALSE_DISCOVERY_RATE as RULES_RATE
from abhv_mc.statistics.failure_drivers import FEWEST_FAILURES, bin_inputs, find_rules
from abhv_mc.statistics.failure_rules import Condition, Rule
from abhv_mc.statistics.given_data import given_data_indices
from abhv_mc.topics.failed_flights import failure_kinds
from abhv_mc.topics.parameter_words import shown_value, spoken_name
from abhv_mc.topics.plain import interval_at, plain
from abhv_mc.topics.words import percent

_COUNTS = ("failures_inside", "failures", "others_inside", "others", "p_value", "q_value")
_LISTED = 12  # parameters of a metric, largest first
_MOST_FLIGHTS = 5_000  # the first so many tell correlations of 0.05 from chance


def driver_numbers(results: Results) -> dict[str, Any]:
    """Rank coefficients of every metric and rules of every kind of failure; empty without dispersions."""
    names = list(results.dispersed)
    if not names:
        return {}
    numbers: dict[str, Any] = {}
    for controller in results.controllers:
        flights = results.flights[controller]
        kinds = failure_kinds(results, controller)
        binned = (
            bin_inputs(column[flights.flight] for column in map(results.samples.__getitem__, names)) if kinds else None
        )

        def column(index: int, flown: NDArray[np.int64] = flights.flight) -> NDArray[np.float64]:
            return np.asarray(results.samples[names[index]][flown], dtype=np.float64)

        numbers[controller] = {
            "metrics": _coefficients(results, controller),
            "failures": [
                {
                    "kind": kind,
                    "flights": int(failed.size),
                    "failures": int(failed.sum()),
                    "rules": [_rule(rule, names) for rule in find_rules(binned, failed, column)] if binned else [],
                }
                for kind, failed in kinds
            ],
        }
    return {
        "false_discovery_rate": FALSE_DISCOVERY_RATE,
        "rules_false_discovery_rate": RULES_RATE,
        "fewest_failures": FEWEST_FAILURES,
        "controllers": numbers,
    }


def _coefficients(results: Results, controller: str) -> dict[str, Any]:
    metrics, names = list(results.metrics), list(results.dispersed)
    flights = results.flights[controller]
    first = np.arange(min(flights.flight.size, _MOST_FLIGHTS))
    outputs = np.column_stack([distances(flights, metric, first) for metric in metrics])
    inputs, folded = [], []
    for sampled in map(results.samples.__getitem__, names):
        inputs.append(sampled[flights.flight[first]])
        # A largest absolute error often grows with a parameter's distance from its middle, whichever way; ranks of
        # the parameter alone do not see that.
        finite = sampled[flights.flight]
        finite = finite[np.isfinite(finite)]  # a failure that never comes is far from every time
        folded.append(np.abs(inputs[-1] - (np.median(finite) if finite.size else 0.0)))
    drivers = rank_drivers(np.column_stack([*inputs, *folded]), outputs)
    if drivers is None:
        return {}
    table = {}
    otherwise = _given_data(results, np.column_stack(inputs), outputs, drivers.tells)
    for column, metric in enumerate(metrics):
        if not np.isfinite(drivers.explained[column]):
            continue
        order = np.argsort(-np.abs(np.nan_to_num(drivers.srrc[:, column])), kind="stable")[:_LISTED]
        table[metric] = {
            "explained": plain(drivers.explained[column]),
            "tells": bool(drivers.tells[column]),
            "otherwise": otherwise.get(metric, []),
            "parameters": [
                {
                    "parameter": names[row % len(names)],
                    "either_way": bool(row >= len(names)),
                    **{kind: interval_at(drivers, kind, row, column) for kind in ("srrc", "prcc")},
                    "p_value": plain(drivers.p_value[row, column]),
                    "driver": bool(drivers.found[row, column]),
                    "moves_with": names[partner % len(names)] if partner >= 0 else None,
                }
                for row, partner in zip(order, drivers.moves_with[order, column].tolist(), strict=True)
            ],
        }
    return table


def _given_data(
    results: Results, inputs: NDArray[np.float64], outputs: NDArray[np.float64], tells: NDArray[np.bool_]
) -> dict[str, list[dict[str, Any]]]:
    """Parameters that decide a headline error in another way than steadily up or down, largest first.

    By first-order and total indices from the flights, of metrics that the rank regression does not explain. Designs
    whose flights are no random draws have an order that these would take for an effect.
    """
    names = list(results.dispersed)
    chosen = [c for c, metric in enumerate(results.metrics) if metric in results.asked and not tells[c]]
    found = given_data_indices(inputs, outputs[:, chosen]) if chosen and results.campaign.independent else None
    if found is None:
        return {}
    metrics = list(results.metrics)
    return {
        metrics[column]: [
            {
                "parameter": names[row],
                "first": plain(found.first[row, place]),
                "total": plain(found.total[row, place]),
                "partner": names[found.partner[row, place]] if found.partner[row, place] >= 0 else None,
            }
            for row in np.argsort(-found.total[:, place], kind="stable").tolist()
            if found.found[row, place]
        ]
        for place, column in enumerate(chosen)
    }


def _condition_words(condition: Condition, names: list[str]) -> str:
    """'wind north > 25 m/s'; a difference in standard deviations."""
    name, sign = names[condition.input], ">" if condition.above else "≤"
    if condition.minus is None:
        return f"{spoken_name(name)} {sign} {shown_value(name, condition.threshold)}"
    other = spoken_name(names[condition.minus])
    return f"{spoken_name(name)} minus {other}, each in standard deviations, {sign} {condition.threshold:.2f}"


def _rule(rule: Rule, names: list[str]) -> dict[str, Any]:
    words = (" or " if rule.either else " and ").join(_condition_words(c, names) for c in rule.conditions)
    inside, outside = rule.failures_inside / rule.failures, rule.others_inside / rule.others
    return {
        "where": words,
        "rule": f"{words}: {percent(inside, 2)} of the failures, {percent(outside, 2)} of the rest",
        "conditions": [
            {
                "parameter": names[c.input],
                "minus": None if c.minus is None else names[c.minus],
                "above": c.above,
                "threshold": c.threshold,
            }
            for c in rule.conditions
        ],
        **{key: getattr(rule, key) for key in _COUNTS},
    }


def otherwise_words(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """'drag' of a parameter that acts alone, 'lift together with density' of two that mostly do not, each name once."""
    words: list[str] = []
    told: set[str] = set()
    for entry in entries:
        name, partner = entry["parameter"], entry["partner"]
        if name in told:
            continue
        together = partner is not None and partner not in told and entry["first"] < entry["total"] / 2.0
        words.append(f"{spoken_name(name)} together with {spoken_name(partner)}" if together else spoken_name(name))
        told |= {name, partner} if together else {name}
    return words
