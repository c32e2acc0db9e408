"""What a campaign's numbers would be under other dispersions, from the flights that were flown."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.analysis.reweight import make_change, unseen_probability, weigh_flights
from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.folder.controller_flights import ControllerFlights, severities
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.results import Results, read_results
from abhv_mc.io.documents import InputError
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import LEVELS, Interval, quantile
from abhv_mc.statistics.reweight import Unseen, effective_size, weighted_quantile, weighted_share
from abhv_mc.topics.failed_flights import requirement_failures, requirement_words
from abhv_mc.topics.plain import level_name, plain

FEWEST_EFFECTIVE = 100.0  # flights
MOST_UNSEEN = 0.01  # probability of values that no flight had


def make_whatif(root: Path, settings: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Quantiles of every metric and failures of every requirement, as flown and with other settings of dispersions.

    ``settings`` maps parameters to keys of their entries in the campaign file. Raises InputError where the flights do
    not cover what is asked, or too few of them count.
    """
    results = read_results(root)
    campaign = read_campaign(CampaignFolder(root).campaign)
    change = make_change(campaign, settings)
    samples = np.column_stack([results.samples[name] for name in campaign.names])
    controllers = {}
    for name in results.controllers:
        flights = results.flights[name]
        rows = samples[flights.flight]
        weights = weigh_flights(campaign, change, rows)
        effective, unseen = effective_size(weights), unseen_probability(campaign, change, rows)
        _refuse_too_little(root, effective, unseen, flights)
        controllers[name] = {
            "flights": int(flights.flight.size),
            "effective_flights": effective,
            "unseen": unseen.joint,
            "requirements": _requirements(results, flights, weights, unseen.joint),
            "metrics": _metrics(results, flights, weights, unseen.joint),
        }
    results.refuse_changes()
    return {
        "before": plain(change.before),
        "after": plain(change.after),
        "stopped_when_proven": campaign.model.stop is not None,
        "asked": list(results.compared),
        "words": {name: results.campaign.metrics[name].as_words() for name in results.metrics},
        "controllers": controllers,
    }


def _refuse_too_little(root: Path, effective: float, unseen: Unseen, flights: ControllerFlights) -> None:
    total = flights.flight.size
    most = max(unseen.single, unseen.joint)
    if most > MOST_UNSEEN:
        found = f"{100.0 * most:.2g} % of the probability beyond all {total} flights"
        raise InputError(root, found, f"at most {100.0 * MOST_UNSEEN:g} %: fly a fresh campaign")
    if effective < FEWEST_EFFECTIVE:
        found = f"flights worth {effective:.0f}, of {total} flown"
        expected = f"an effective number of at least {FEWEST_EFFECTIVE:g}: a smaller change, more flights, or a fresh"
        raise InputError(root, found, f"{expected} campaign")


def _requirements(results: Results, flights: ControllerFlights, weights: Floats, unseen: float) -> list[dict[str, Any]]:
    listed = []
    for item in results.campaign.requirements:
        failed = requirement_failures(flights, item)
        count = int(failed.sum())
        before = Interval(count / failed.size, *clopper_pearson(count, failed.size))
        after = weighted_share(failed, weights, unseen)
        entry = {
            "metric": item.metric,
            "words": requirement_words(item, flights.records),
            "probability": item.probability,
        }
        listed.append(entry | {"failure_share": {"before": plain(before), "after": plain(after)}})
    return listed


def _metrics(results: Results, flights: ControllerFlights, weights: Floats, unseen: float) -> dict[str, Any]:
    table = {}
    for metric in results.metrics:
        values, sense = severities(flights, metric), flights.records[metric].bad
        table[metric] = {
            level_name(level): {
                "before": plain(quantile(values, level).in_sense(sense)),
                "after": plain(weighted_quantile(values, weights, level, unseen).in_sense(sense)),
            }
            for level in LEVELS
        }
    return table
