"""Which flights count as failures, and of what."""

import numpy as np
from numpy.typing import NDArray

from abhv_mc.report.numbers.flights import ControllerFlights
from abhv_mc.report.numbers.metrics import words_of
from abhv_mc.report.numbers.results import Requirement, Results
from abhv_mc.statistics.judgement import Pair, judge_pairs
from abhv_mc.statistics.requirement import requirement_failures as failures
from abhv_mc.statistics.verdicts import Verdict

EARLY = "ended early"


def requirement_failures(flights: ControllerFlights, requirement: Requirement) -> NDArray[np.bool_]:
    """Which flights [flight] of a controller miss a requirement.

    A flight that ended early misses it, unless the requirement takes such flights as measured.
    """
    values, early = flights.metrics[requirement.metric], flights.failed
    return failures(values, early, requirement.limit, requirement.below, requirement.early_is_failure)


def failed_anyhow(flights: ControllerFlights, requirements: tuple[Requirement, ...]) -> NDArray[np.bool_]:
    """Which flights [flight] ended early or miss any requirement."""
    failed = flights.failed.copy()
    for item in requirements:
        failed |= requirement_failures(flights, item)
    return failed


def judge_all(results: Results) -> list[dict[str, Verdict]]:
    """Verdicts of each requirement by controller, as the manifest has them: all pairs are one family."""
    names, items = results.controllers, results.campaign.requirements
    pairs = [_pair(results, results.flights[name], item) for name in names for item in items]
    verdicts = iter(judge_pairs(pairs, results.rules))
    table = {name: [next(verdicts) for _ in items] for name in names}
    return [{name: table[name][i] for name in names} for i in range(len(items))]


def _pair(results: Results, flights: ControllerFlights, requirement: Requirement) -> Pair:
    """One requirement on one controller, in flight order up to the first flight that is missing."""
    numbers = np.concatenate([flights.flight, flights.absent])
    order = np.argsort(numbers, kind="stable")
    missed = np.concatenate([requirement_failures(flights, requirement), np.zeros(flights.absent.size, np.bool_)])
    uncomputed = np.arange(numbers.size) >= flights.flight.size
    gapless = int(np.sum(numbers[order] == np.arange(numbers.size)))
    kept = order[:gapless] if results.rules.looks or results.campaign.looks else order
    return Pair(missed[kept], uncomputed[kept], requirement.probability, requirement.consumer_risk)


def requirement_words(requirement: Requirement) -> str:
    """'Altitude error, max < 50 m'."""
    return limit_words(requirement.metric, requirement.limit, requirement.below)


def limit_words(metric: str, limit: float, below: bool) -> str:
    """The same of a metric and its limit."""
    words = words_of(metric)
    return f"{words.label} {'<' if below else '>'} {limit:g}\N{NO-BREAK SPACE}{words.unit}".strip()


def failure_kinds(results: Results, controller: str) -> list[tuple[str, NDArray[np.bool_]]]:
    """Each way to fail that occurred: ended early, and each requirement missed."""
    early = results.flights[controller].failed
    kinds = [(EARLY, early)]
    kinds += [
        (f"missed: {requirement_words(item)}", requirement_failures(results.flights[controller], item))
        for item in results.campaign.requirements
    ]
    return [(words, failed) for words, failed in kinds if failed.any()]
