"""Which flights count as failures, and of what."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from abhv_mc.flight.metrics import Metric
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.results import Requirement, Results
from abhv_mc.numerics.bounds import Bounds
from abhv_mc.statistics.judgement import Pair, judge_pairs
from abhv_mc.statistics.verdicts import Verdict, tolerance_limit

EARLY = "ended early"


def requirement_failures(flights: ControllerFlights, requirement: Requirement) -> NDArray[np.bool_]:
    """Which flights [flight] of a controller miss a requirement.

    A flight that ended early misses it, unless the requirement takes such flights as measured.
    """
    values, early = flights.metrics[requirement.metric], flights.failed
    return requirement.limits.failures(values, early & requirement.early_is_failure)


def failed_anyhow(flights: ControllerFlights, requirements: tuple[Requirement, ...]) -> NDArray[np.bool_]:
    """Which flights [flight] ended early or miss any requirement."""
    failed = flights.failed.copy()
    for item in requirements:
        failed |= requirement_failures(flights, item)
    return failed


def judge_all(results: Results) -> list[dict[str, Verdict]]:
    """Verdicts of each requirement by controller, as the manifest has them: all pairs are one family."""
    names, items = results.controllers, results.campaign.requirements
    pairs = [_pair(results.flights[name], item) for name in names for item in items]
    verdicts = iter(judge_pairs(pairs, results.campaign.independent, results.campaign.family_risk))
    table = {name: [next(verdicts) for _ in items] for name in names}
    return [{name: table[name][i] for name in names} for i in range(len(items))]


def _pair(flights: ControllerFlights, requirement: Requirement) -> Pair:
    """The counts of one requirement on one controller."""
    failures, absent = int(requirement_failures(flights, requirement).sum()), flights.not_computed
    risks = requirement.consumer_risk, requirement.producer_risk
    return Pair(failures, int(flights.flight.size) + absent, absent, requirement.probability, *risks)


def find_tolerance(flights: ControllerFlights, requirement: Requirement) -> dict[str, float | bool | None]:
    """What the required share of flights stays within, by the rule of the verdict, and the room to the limit.

    Both are None where the flights are too few, or too many were lost (`beyond_lost`); `room` is a share of the limit.
    Of two limits the first is the distance outside them, negative inside, and `room` a share of half their distance.
    """
    limits = requirement.limits
    worse = limits.worse(flights.metrics[requirement.metric])
    worse[np.isnan(worse) | (flights.failed & requirement.early_is_failure)] = np.inf
    found = tolerance_limit(worse, flights.not_computed, requirement.probability, requirement.consumer_risk)
    if found is None or not np.isfinite(found):
        return {"tolerance_limit": None, "room": None, "beyond_lost": found is not None}
    room = (limits.limit - found) / limits.size if limits.size else None
    return {"tolerance_limit": limits.sign * found, "room": room, "beyond_lost": False}


def requirement_words(requirement: Requirement, records: Mapping[str, Metric]) -> str:
    """'Altitude error, max < 50 m'."""
    return limit_words(records[requirement.metric], requirement.limits)


def limit_words(metric: Metric, limits: Bounds) -> str:
    """The same of a metric and its limits."""
    return f"{metric.label} {metric.with_unit(limits.symbols)}"


def failure_kinds(results: Results, controller: str) -> list[tuple[str, NDArray[np.bool_]]]:
    """Each way to fail that occurred: ended early, and each requirement missed."""
    early = results.flights[controller].failed
    kinds = [(EARLY, early)]
    kinds += [
        (
            f"missed: {requirement_words(item, results.campaign.metrics)}",
            requirement_failures(results.flights[controller], item),
        )
        for item in results.campaign.requirements
    ]
    return [(words, failed) for words, failed in kinds if failed.any()]
