"""Which flights count as failures, and of what."""

import numpy as np
from numpy.typing import NDArray

from abhv_mc.report.flights import ControllerFlights
from abhv_mc.report.metrics import words_of
from abhv_mc.report.results import Requirement, Results
from abhv_mc.statistics.requirement import requirement_failures as failures
from abhv_mc.statistics.sequential import (
    at_least_as_bad,
    at_least_as_good,
    make_sequential_plan,
    sequential_lower_bound,
    sequential_verdict,
)
from abhv_mc.statistics.verdicts import Verdict

EARLY = "ended early"


def requirement_failures(flights: ControllerFlights, requirement: Requirement) -> NDArray[np.bool_]:
    """Which flights [flight] of a controller miss a requirement.

    A flight that ended early misses it, unless the requirement takes such flights as measured.
    """
    values, early = flights.metrics[requirement.metric], flights.failed
    return failures(values, early, requirement.limit, requirement.below, requirement.early_is_failure)


def sequential_evidence(flights: ControllerFlights, requirement: Requirement, looks: tuple[int, ...]) -> Verdict:
    """The verdict of a campaign that stops when proven, with bounds and risks that allow for the looks.

    A flight that could not be computed counts as a failure: nothing shows that it held.
    """
    last = int(flights.flight[-1]) + 1
    missed = np.ones(last, dtype=np.bool_)
    missed[flights.flight] = requirement_failures(flights, requirement)
    plan = make_sequential_plan(looks, requirement.probability, requirement.consumer_risk)
    found = sequential_verdict(missed, plan)
    return Verdict(
        found.status,
        found.failures,
        found.flights,
        requirement.probability,
        requirement.consumer_risk,
        sequential_lower_bound(found, plan),
        at_least_as_good(found, plan, requirement.probability),
        at_least_as_bad(found, plan, requirement.probability),
        0 if found.status == "PASS" else None,
    )


def requirement_words(requirement: Requirement) -> str:
    """'Altitude error, max < 50 m'."""
    words = words_of(requirement.metric)
    limit = f"{requirement.limit:g}"
    return f"{words.label} {'<' if requirement.below else '>'} {limit}\N{NO-BREAK SPACE}{words.unit}".strip()


def failure_kinds(results: Results, controller: str) -> list[tuple[str, NDArray[np.bool_]]]:
    """Each way to fail that occurred: ended early, and each requirement missed."""
    early = results.flights[controller].failed
    kinds = [(EARLY, early)]
    kinds += [
        (f"missed: {requirement_words(item)}", requirement_failures(results.flights[controller], item))
        for item in results.campaign.requirements
    ]
    return [(words, failed) for words, failed in kinds if failed.any()]
