"""Chances that a planned campaign results in PASS, and the number of flights it needs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.feasibility import asked_in_vain
from abhv_mc.campaign.sampling.designs import INDEPENDENT
from abhv_mc.statistics.evidence import flights_to_pass, most_failures
from abhv_mc.statistics.flights_planned import PLANNED_FAILURES, ever_chance, pass_chance, together
from abhv_mc.statistics.unknowns import most_points, search_flights
from abhv_mc.topics.missed_requirements import limit_words

RUN_FACTORS = (1, 2, 4)  # multiples of the planned number of flights
# ratios of the true to the allowed failure rate, including 0.2 and 1
_RATES = np.concatenate(
    [
        [0.0],
        *(np.geomspace(*ends)[:-1] for ends in ((0.02, 0.2, 8), (0.2, 1.0, 13))),
        np.geomspace(1.0, 3.0, 5),
    ]
)


@dataclass(frozen=True)
class PassChance:
    """Chance of PASS by true failure rate [rate], after a number of flights."""

    runs: int
    # chance of PASS if verdicts are checked after each flight up to ``runs``
    at_some_flight: Floats
    at_runs: Floats  # chance of PASS if verdicts are checked once, after ``runs`` flights


@dataclass(frozen=True)
class PlannedRequirement:
    """Numbers of flights and chances of PASS for one requirement."""

    metric: str
    words: str
    probability: float
    consumer_risk: float
    risk_used: float
    flights_for_failures: Mapping[str, int]
    most_failures_at_runs: int
    pass_chance: tuple[PassChance, ...]


@dataclass(frozen=True)
class Band:
    """Lower and upper bounds on a chance, by true failure rate [rate]."""

    low: Floats
    high: Floats


@dataclass(frozen=True)
class JointPassChance:
    """Bounds on the chance that the verdicts on all requirements are PASS."""

    runs: int
    at_some_flight: Band
    at_runs: Band


@dataclass(frozen=True)
class Planned:
    """Planned number of flights, and the chances of PASS by requirement and jointly."""

    name: str
    runs: int
    independent_flights: bool
    stops_when_proven: bool
    family_risk: float | None
    verdicts: int
    rates_over_allowed: Floats  # true failure rates divided by the allowed failure rate [rate]
    requirements: tuple[PlannedRequirement, ...]
    together: tuple[JointPassChance, ...]
    problems: Sequence[str]
    # number of points of the unknowns, each with ``runs`` flights of each controller
    most_points: int = 1
    # number of flights of all controllers in the search for points of the unknowns
    search_flights: int = 0


def plan_campaign(campaign: Experiment) -> Planned:
    """Return the chances of PASS for 1, 2 and 4 times the planned number of flights."""
    model, runs = campaign.model, campaign.runs_at_point
    verdicts = len(model.requirements) * len(campaign.controllers)
    requirements = []
    for item in campaign.requirements:
        # With a joint risk, each verdict is planned with its share of this risk (first step of
        # Holm's procedure).
        risk = (
            min(item.consumer_risk, model.family.risk / verdicts)
            if model.family
            else item.consumer_risk
        )
        target = item.probability, risk
        rates = np.minimum(_RATES * (1.0 - item.probability), 1.0)
        requirements.append(
            PlannedRequirement(
                metric=item.metric,
                words=limit_words(campaign.metrics[item.metric], item.limits),
                probability=item.probability,
                consumer_risk=item.consumer_risk,
                risk_used=risk,
                flights_for_failures={
                    str(k): flights_to_pass(k, *target) for k in PLANNED_FAILURES
                },
                most_failures_at_runs=most_failures(runs, *target),
                pass_chance=tuple(
                    PassChance(n, ever_chance(n, *target, rates), pass_chance(n, *target, rates))
                    for n in (times * runs for times in RUN_FACTORS)
                ),
            )
        )
    unknowns, points, flights = len(campaign.unknowns.names), len(campaign.unknowns.points), 0
    if unknowns and model.points is None:
        points = most_points(unknowns, verdicts)
        flights = search_flights(unknowns, len(model.requirements), runs)
        flights *= len(campaign.controllers)
    return Planned(
        name=model.name,
        runs=runs,
        independent_flights=model.sampling.design == INDEPENDENT,
        stops_when_proven=model.stop is not None,
        family_risk=model.family.risk if model.family else None,
        verdicts=verdicts,
        rates_over_allowed=_RATES,
        requirements=tuple(requirements),
        together=tuple(
            JointPassChance(
                chances[0].runs,
                Band(*together([chance.at_some_flight for chance in chances])),
                Band(*together([chance.at_runs for chance in chances])),
            )
            for chances in zip(*(entry.pass_chance for entry in requirements), strict=True)
        ),
        problems=asked_in_vain(campaign),
        most_points=points,
        search_flights=flights,
    )
