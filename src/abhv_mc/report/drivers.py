"""What drives each metric and where failures live, for each controller."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.report.failures import failure_kinds
from abhv_mc.report.parameters import shown_value
from abhv_mc.report.plain import plain
from abhv_mc.report.results import Floats, Results
from abhv_mc.report.severities import severities
from abhv_mc.report.sobol import independent_rows
from abhv_mc.report.words import percent
from abhv_mc.statistics.drivers import FALSE_DISCOVERY_RATE, rank_drivers
from abhv_mc.statistics.failure_drivers import FALSE_DISCOVERY_RATE as RULES_RATE
from abhv_mc.statistics.failure_drivers import FEWEST_FAILURES, Rule, find_rules

_LISTED = 12  # parameters of a metric, largest first
_MOST_FLIGHTS = 5_000  # the first so many tell correlations of 0.05 from chance


def driver_numbers(results: Results) -> dict[str, Any]:
    """Rank coefficients of every metric and rules of every kind of failure; empty without dispersions."""
    names = list(results.samples)
    if not names:
        return {}
    everything = np.column_stack([results.samples[name] for name in names])
    numbers: dict[str, Any] = {}
    for controller in results.controllers:
        flights = results.flights[controller]
        independent = independent_rows(results, flights.flight)
        inputs = everything[flights.flight][independent]
        numbers[controller] = {
            "metrics": _coefficients(results, controller, names, inputs, independent),
            "failures": [
                {
                    "kind": kind,
                    "flights": int(failed.size),
                    "failures": int(failed.sum()),
                    "rules": [_rule(rule, names) for rule in find_rules(inputs, failed[independent])],
                }
                for kind, failed in failure_kinds(results, controller)
            ],
        }
    return {
        "false_discovery_rate": FALSE_DISCOVERY_RATE,
        "rules_false_discovery_rate": RULES_RATE,
        "fewest_failures": FEWEST_FAILURES,
        "controllers": numbers,
    }


def _coefficients(
    results: Results, controller: str, names: list[str], inputs: Floats, independent: NDArray[np.bool_]
) -> dict[str, Any]:
    metrics = list(results.metrics)
    flights = results.flights[controller]
    outputs = np.column_stack([severities(flights, metric)[independent] for metric in metrics])
    # A largest absolute error often grows with a parameter's distance from its middle, whichever way; ranks of the
    # parameter alone do not see that.
    folded = np.abs(inputs - np.median(inputs, axis=0))
    both = np.concatenate([inputs, folded], axis=1)
    drivers = rank_drivers(both[:_MOST_FLIGHTS], outputs[:_MOST_FLIGHTS])
    if drivers is None:
        return {}
    table = {}
    for column, metric in enumerate(metrics):
        if not np.isfinite(drivers.explained[column]):
            continue
        order = np.argsort(-np.abs(np.nan_to_num(drivers.srrc[:, column])), kind="stable")[:_LISTED]
        table[metric] = {
            "explained": plain(drivers.explained[column]),
            "parameters": [
                {
                    "parameter": names[row % len(names)],
                    "either_way": bool(row >= len(names)),
                    "srrc": plain(
                        [drivers.srrc[row, column], drivers.srrc_low[row, column], drivers.srrc_high[row, column]]
                    ),
                    "prcc": plain(
                        [drivers.prcc[row, column], drivers.prcc_low[row, column], drivers.prcc_high[row, column]]
                    ),
                    "p_value": plain(drivers.p_value[row, column]),
                    "driver": bool(drivers.found[row, column]),
                }
                for row in order
            ],
        }
    return table


def _rule(rule: Rule, names: list[str]) -> dict[str, Any]:
    words = " and ".join(
        f"{names[c.input]} {'>' if c.above else '≤'} {shown_value(names[c.input], c.threshold)}"
        for c in rule.conditions
    )
    inside, outside = rule.failures_inside / rule.failures, rule.others_inside / rule.others
    return {
        "rule": f"{words}: {percent(inside, 2)} of the failures, {percent(outside, 2)} of the rest",
        "conditions": [
            {"parameter": names[c.input], "above": c.above, "threshold": c.threshold} for c in rule.conditions
        ],
        "failures_inside": rule.failures_inside,
        "failures": rule.failures,
        "others_inside": rule.others_inside,
        "others": rule.others,
        "p_value": rule.p_value,
        "q_value": rule.q_value,
    }
