"""Which flights count as failures, and of what."""

import numpy as np
from numpy.typing import NDArray

from abhv_mc.report.metrics import METRIC_WORDS, words_of
from abhv_mc.report.results import ControllerFlights, Requirement, Results


def requirement_failures(flights: ControllerFlights, requirement: Requirement) -> NDArray[np.bool_]:
    """Which flights [flight] of a controller miss a requirement.

    A flight that ended early misses it, unless the requirement takes such flights as measured.
    """
    missed = ~requirement.held(flights.metrics[requirement.metric])
    return missed | flights.failed if requirement.early_is_failure else missed


def requirement_words(requirement: Requirement) -> str:
    """'Altitude error, max < 50 m'."""
    words = METRIC_WORDS.get(requirement.metric) or words_of(requirement.metric)
    limit = f"{requirement.limit:g}"
    return f"{words.label} {'<' if requirement.below else '>'} {limit}\N{NO-BREAK SPACE}{words.unit}".strip()


def failure_kinds(results: Results, controller: str) -> list[tuple[str, NDArray[np.bool_]]]:
    """Each way to fail that occurred: ended early, and each requirement missed."""
    early = results.flights[controller].failed
    kinds = [("ended early", early)]
    kinds += [
        (f"missed: {requirement_words(item)}", requirement_failures(results.flights[controller], item))
        for item in results.campaign.requirements
    ]
    return [(words, failed) for words, failed in kinds if failed.any()]
