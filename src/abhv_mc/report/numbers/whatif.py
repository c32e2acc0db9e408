"""Estimates for a campaign with other dispersions, by re-weighting stored flights."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.analysis.reweight import make_change, unseen_probability, weigh_flights
from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.campaign.file.requirement_set import RequirementSource
from abhv_mc.folder.controller_flights import ControllerFlights, severities
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.inputs import read_folder_campaign
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.messages import InputError
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import LEVELS, Interval, quantile
from abhv_mc.statistics.reweight import effective_size, weighted_quantile, weighted_share
from abhv_mc.topics.formatting import level_name
from abhv_mc.topics.missed_requirements import requirement_failures, requirement_words

FEWEST_EFFECTIVE = 100.0  # minimum effective number of flights
# minimum ratio of effective to actual flights for which intervals have sufficient coverage
LEAST_EFFECTIVE = 0.5
MOST_UNSEEN = 0.01  # maximum probability of values outside the range covered by the flights


@dataclass(frozen=True)
class Pair:
    """Estimate with the simulated dispersions and with the changed dispersions."""

    before: Interval
    after: Interval


@dataclass(frozen=True)
class WhatifRequirement:
    """Share of flights that fail to meet a requirement."""

    metric: str
    words: str
    probability: float
    failure_share: Pair


@dataclass(frozen=True)
class WhatifController:
    """Flights of one controller, and their effective number under the changed settings."""

    flights: int
    effective_flights: float
    unseen: float  # probability of values outside the range of all flights
    requirements: tuple[WhatifRequirement, ...]
    metrics: Mapping[str, Mapping[str, Pair]]  # estimates by metric and level


@dataclass(frozen=True)
class Whatif:
    """Estimates for a campaign under changed settings of its dispersions."""

    before: Mapping[str, Mapping[str, object]]
    after: Mapping[str, Mapping[str, object]]
    stopped_when_proven: bool
    asked: tuple[str, ...]
    words: Mapping[str, Mapping[str, str]]
    controllers: Mapping[str, WhatifController]


def make_whatif(
    root: Path,
    settings: Mapping[str, Mapping[str, Any]],
    requirements: RequirementSource | None = None,
) -> Whatif:
    """Return quantiles and failure shares for the simulated and the changed ``settings``.

    Raise InputError if the flights do not cover the new distributions or their effective number is
    too small.
    """
    results = read_flown(root, requirements)
    campaign = read_folder_campaign(CampaignFolder(root))
    change = make_change(campaign, settings)
    samples = np.column_stack([results.samples[name] for name in campaign.names])
    controllers = {}
    for name in results.controllers:
        flights = results.flights[name]
        rows = samples[flights.flight]
        weights = weigh_flights(campaign, change, rows)
        effective, unseen = effective_size(weights), unseen_probability(campaign, change, rows)
        total, most = flights.flight.size, max(unseen.single, unseen.joint)
        if most > MOST_UNSEEN:
            raise InputError(
                root,
                f"{100.0 * most:.2g} % of the changed distribution lies outside the range of the "
                f"{total} flights",
                f"at most {100.0 * MOST_UNSEEN:g} %, or a new campaign",
            )
        if effective < (least := max(FEWEST_EFFECTIVE, LEAST_EFFECTIVE * total)):
            problem = f"the effective number of flights is {effective:.0f} of {total}"
            remedy = "use a smaller change, more flights, or a new campaign"
            raise InputError(root, problem, f"at least {least:g} ({remedy})")
        metrics = {
            metric: _reweight_quantiles(flights, metric, weights, unseen.joint)
            for metric in results.metrics
        }
        reweighted = tuple(
            _reweight_requirement(flights, item, weights, unseen.joint)
            for item in results.campaign.requirements
        )
        controllers[name] = WhatifController(total, effective, unseen.joint, reweighted, metrics)
    results.refuse_changes()
    labels = {name: results.campaign.metrics[name].as_texts() for name in results.metrics}
    stopped = campaign.model.stop is not None
    return Whatif(change.before, change.after, stopped, results.compared, labels, controllers)


def _reweight_requirement(
    flights: ControllerFlights, item: Requirement, weights: Floats, unseen: float
) -> WhatifRequirement:
    failed = requirement_failures(flights, item)
    count = failed.sum()
    before = Interval(count / failed.size, *clopper_pearson(count, failed.size))
    shares = Pair(before, weighted_share(failed, weights, unseen))
    return WhatifRequirement(
        item.metric, requirement_words(item, flights.records), item.probability, shares
    )


def _reweight_quantiles(
    flights: ControllerFlights, metric: str, weights: Floats, unseen: float
) -> dict[str, Pair]:
    values, sense = severities(flights, metric), flights.records[metric].bad
    return {
        level_name(level): Pair(
            quantile(values, level).in_sense(sense),
            weighted_quantile(values, weights, level, unseen).in_sense(sense),
        )
        for level in LEVELS
    }
