"""What a campaign can show before it flies: flights needed, and the chance of PASS against the true failure rate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.designs import INDEPENDENT
from abhv_mc.simulators.feasibility import asked_in_vain
from abhv_mc.statistics.evidence import flights_to_pass, most_failures
from abhv_mc.statistics.flights_planned import PLANNED_FAILURES, ever_chance, pass_chance, together
from abhv_mc.statistics.unknowns import most_points, search_flights
from abhv_mc.topics.missed_requirements import limit_words

TIMES = (1, 2, 4)  # the planned number of flights
# True failure rates over the allowed one, a fifth and the whole of it among them.
_RATES = np.concatenate(
    [
        [0.0],
        *(np.geomspace(*ends)[:-1] for ends in ((0.02, 0.2, 8), (0.2, 1.0, 13))),
        np.geomspace(1.0, 3.0, 5),
    ]
)


@dataclass(frozen=True)
class PassChance:
    """Chance of PASS [rate] at some flight up to so many, for one who looks after each, and at that number itself."""

    runs: int
    at_some_flight: Floats
    at_runs: Floats


@dataclass(frozen=True)
class PlannedRequirement:
    """What one requirement needs."""

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
    """Bounds of a chance [rate]."""

    low: Floats
    high: Floats


@dataclass(frozen=True)
class Together:
    """Chance that all requirements PASS."""

    runs: int
    at_some_flight: Band
    at_runs: Band


@dataclass(frozen=True)
class Planned:
    """For each requirement, and for all of them together, flights and chances of PASS."""

    name: str
    runs: int
    independent_flights: bool
    stops_when_proven: bool
    family_risk: float | None
    verdicts: int
    rates_over_allowed: (
        Floats  # [rate] the true failure rate divided by what the requirement allows
    )
    requirements: tuple[PlannedRequirement, ...]
    together: tuple[Together, ...]
    problems: Sequence[str]
    most_points: int = 1  # of the unknowns, at each of which every controller flies as many
    search_flights: int = 0  # of all controllers, before these


def plan_campaign(campaign: Experiment) -> Planned:
    """What a campaign with requirements can show at its planned number of flights, and at two and four times that."""
    model, runs = campaign.model, campaign.runs_at_point
    verdicts = len(model.requirements) * len(campaign.controllers)
    requirements = []
    for item in campaign.requirements:
        # Where a family is held, each verdict is planned with its share of the risk: Holm's first step.
        risk = (
            min(item.consumer_risk, model.family.risk / verdicts)
            if model.family
            else item.consumer_risk
        )
        asked = item.probability, risk
        rates = np.minimum(_RATES * (1.0 - item.probability), 1.0)
        requirements.append(
            PlannedRequirement(
                item.metric,
                limit_words(campaign.metrics[item.metric], item.limits),
                item.probability,
                item.consumer_risk,
                risk,
                {str(k): flights_to_pass(k, *asked) for k in PLANNED_FAILURES},
                most_failures(runs, *asked),
                tuple(PassChance(n, ever_chance(n, *asked, rates), pass_chance(n, *asked, rates))
                      for n in (times * runs for times in TIMES)),
            )
        )  # fmt: skip
    return Planned(
        model.name,
        runs,
        model.sampling.design == INDEPENDENT,
        model.stop is not None,
        model.family.risk if model.family else None,
        verdicts,
        _RATES,
        tuple(requirements),
        tuple(
            Together(
                chances[0].runs,
                Band(*together([chance.at_some_flight for chance in chances])),
                Band(*together([chance.at_runs for chance in chances])),
            )
            for chances in zip(*(entry.pass_chance for entry in requirements), strict=True)
        ),
        asked_in_vain(campaign),
        *_points(campaign),
    )


def _points(campaign: Experiment) -> tuple[int, int]:
    """The most points of the unknowns that are judged, and the flights of the search that finds them."""
    unknowns, asked = len(campaign.unknowns.names), len(campaign.requirements)
    if not unknowns or campaign.model.points is not None:
        return len(campaign.unknowns.points), 0
    controllers = len(campaign.controllers)
    searched = controllers * search_flights(unknowns, asked, campaign.runs_at_point)
    return most_points(unknowns, controllers * asked), searched
