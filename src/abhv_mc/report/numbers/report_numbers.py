"""Every number of a report, as plain data: `report.json` holds it, the page prints it, `verify campaign` remakes it.

The same folder gives the same numbers to the last bit: seeds are fixed and nothing depends on time or machine.
Infinite and missing values are None.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.flight.metrics import Metric
from abhv_mc.folder.results import Results
from abhv_mc.report.numbers.compare import baseline_numbers
from abhv_mc.report.numbers.findings import finding_numbers, left_out
from abhv_mc.report.numbers.paired import paired_numbers
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import LEVELS, Interval, quantiles, severity
from abhv_mc.topics.labels import full_labels
from abhv_mc.topics.margins import MARGINS
from abhv_mc.topics.margins.sentences import missing_margins
from abhv_mc.topics.plain import interval_in_sense, level_name, plain
from abhv_mc.topics.registry import BUILT_IN, user_topics
from abhv_mc.topics.topic import Models
from abhv_mc.topics.worst_flights import worst_numbers

FORMAT = 1


def _flight_counts(results: Results) -> dict[str, Any]:
    counts = {}
    for name in results.controllers:
        flights = results.flights[name]
        flown, failed = int(flights.flight.size), int(flights.failed.sum())
        ends = clopper_pearson(failed, flown) if results.campaign.independent else (np.nan, np.nan)
        counts[name] = {
            "flown": flown,
            "failed": failed,
            "not_computed": flights.not_computed,
            "outcomes": flights.count_outcomes(),
            "failure_share": plain(Interval(failed / flown, *ends)),
        }
    return counts


def _metric_table(results: Results) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for metric in results.metrics:
        record = results.campaign.metrics[metric]
        entry: dict[str, Any] = {}
        for name in results.controllers:
            flights = results.flights[name]
            measured = flights.metrics[metric]
            values = severity(measured, record.bad, flights.failed)
            cell: dict[str, Any] = {
                level_name(level): interval_in_sense(interval, record.bad)
                for level, interval in zip(LEVELS, quantiles(values, LEVELS), strict=True)
            }
            flown = np.where(flights.failed | np.isnan(measured), -np.inf, values)
            worst = int(np.argmax(flown))
            if np.isfinite(flown[worst]):
                cell["worst"] = float(measured[worst])
                cell["worst_flight"] = int(flights.flight[worst])
            else:
                cell["worst"] = cell["worst_flight"] = None
            entry[name] = cell
        table[metric] = {**record.as_words(), "same_as": _unsettled(results, record), "controllers": entry}
    return table


def _unsettled(results: Results, record: Metric) -> str | None:
    """The metric without the settled stretches' restriction that is the same in every flight; None for none."""
    if not record.settled:
        return None
    for other in map(results.campaign.metrics.__getitem__, results.metrics):
        same = replace(other, name="", doc="", label="", settled=True) == replace(record, name="", doc="", label="")
        if same and not other.settled:
            pairs = (
                (flights.metrics[record.name], flights.metrics[other.name]) for flights in results.flights.values()
            )
            if all(np.array_equal(*pair, equal_nan=True) for pair in pairs):
                return other.name
    return None


def make_numbers(models: Models, baseline: Path | None = None) -> dict[str, Any]:
    """All numbers of the report of a campaign, as JSON holds them; those of a ``baseline`` folder beside where given.

    Raises InputError for a baseline whose flights do not pair with the campaign's.
    """
    results = models.results
    campaign, manifest = results.campaign, results.manifest
    return {
        "format": FORMAT,
        "campaign": {
            **{key: getattr(campaign, key) for key in ("name", "question", "runs", "seed", "sampling")},
            "controllers": list(results.controllers),
            "labels": full_labels(results.folder, results.controllers),
            "stops_when_proven": campaign.stops_when_proven,
            "pooled_seeds": list(campaign.pooled_seeds),
            "independent_flights": campaign.independent,
            "parameters": list(results.dispersed),
            "dispersions": plain(campaign.dispersions),
        },
        "state": manifest.get("state"),
        "warnings": [
            *(manifest.get("warnings") or ()),
            *manifest.get("not_made", ()),
            *missing_margins(models[MARGINS], models.names),
        ],
        "digest": manifest.get("digest"),
        "digests": plain(manifest.get("digests") or {}),
        "flights": _flight_counts(results),
        "asked": list(results.asked),
        "compared": list(results.compared),
        "metrics": _metric_table(results),
        "paired": paired_numbers(results),
        "findings": finding_numbers(results),
        "left_out": left_out(results),
        "worst": worst_numbers(results),
        **{topic.name: plain(models[topic]) for topic in BUILT_IN},
        **({"topics": {topic.name: plain(models[topic]) for topic in user_topics()}} if user_topics() else {}),
        **({"baseline": baseline_numbers(results, baseline)} if baseline else {}),
    }
