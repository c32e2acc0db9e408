"""Estimates for a campaign with other dispersions, by re-weighting stored flights."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.analysis.reweight import make_change, unseen_probability, weigh_flights
from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.requirement_set import RequirementSource
from abhv_mc.folder.controller_flights import severities
from abhv_mc.folder.flown_campaign import FlownCampaign, read_flown
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


class Estimate(NamedTuple):
    """Quantile of a metric, or share of flights that fail to meet a requirement."""

    metric: str
    label: str
    level: str  # such as 'q95', or 'share'
    before: Interval
    after: Interval  # estimate with the changed dispersions


@dataclass(frozen=True)
class WhatifController:
    """Flights of one controller, and their effective number under the changed settings."""

    flights: int
    effective_flights: float
    unseen: float  # probability of values outside the range of all flights
    estimates: tuple[Estimate, ...]


@dataclass(frozen=True)
class Whatif:
    """Estimates for a campaign under changed settings of its dispersions."""

    after: Mapping[str, Mapping[str, object]]  # changed entries of the campaign file
    stopped_when_proven: bool
    asked: tuple[str, ...]
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
        estimates = tuple(estimate_controller(results, name, weights, unseen.joint))
        controllers[name] = WhatifController(total, effective, unseen.joint, estimates)
    results.refuse_changes()
    return Whatif(change.after, campaign.model.stop is not None, results.asked, controllers)


def estimate_controller(
    results: FlownCampaign, name: str, weights: Floats, unseen: float
) -> Iterator[Estimate]:
    """Yield the estimates of a controller from the `weights` [flight] of its flights."""
    flights = results.flights[name]
    for metric in results.metrics:
        values, record = severities(flights, metric), flights.records[metric]
        for level in LEVELS:
            pair = quantile(values, level), weighted_quantile(values, weights, level, unseen)
            before, after = (interval.in_sense(record.bad) for interval in pair)
            yield Estimate(metric, record.label, level_name(level), before, after)
    for item in results.campaign.requirements:
        failed = requirement_failures(flights, item)
        before = Interval(failed.mean(), *clopper_pearson(failed.sum(), failed.size))
        after = weighted_share(failed, weights, unseen)
        words = f"Failed: {requirement_words(item, flights.records)}"
        yield Estimate(item.metric, words, "share", before, after)
