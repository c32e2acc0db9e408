"""Quantiles and the worst flight of every metric of every controller."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from abhv_mc.flight.metrics import Metric
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.estimates import LEVELS, Interval, quantiles, severity
from abhv_mc.topics.plain import DRAWN, level_name


@dataclass(frozen=True)
class ControllerMetric:
    """One metric of one controller."""

    quantiles: Mapping[str, Interval]  # by level, 95 %; flights that ended early are the worst
    worst: float | None  # of the flights that did not; None without one
    worst_flight: int | None


@dataclass(frozen=True)
class MetricTable:
    """One metric of every controller."""

    words: Mapping[str, str]  # what it is called
    same_as: str | None  # the metric without the settled stretches' restriction that is the same in every flight
    controllers: Mapping[str, ControllerMetric]


@dataclass(frozen=True)
class Metrics:
    """Every metric; names of those that stand first, and of those in which controllers are compared."""

    asked: tuple[str, ...]
    compared: tuple[str, ...]
    table: Mapping[str, MetricTable]
    source: FlownCampaign | None = field(default=None, repr=False, metadata={DRAWN: True})


def compute_metrics(results: FlownCampaign) -> Metrics:
    """Every metric that the flights hold."""
    records = results.campaign.metrics
    table = {
        metric: MetricTable(
            records[metric].as_words(),
            _unsettled(results, records[metric]),
            {name: _of(results.flights[name], metric, records[metric]) for name in results.controllers},
        )
        for metric in results.metrics
    }
    return Metrics(results.asked, results.compared, table, results)


def _of(flights: ControllerFlights, metric: str, record: Metric) -> ControllerMetric:
    measured = flights.metrics[metric]
    values = severity(measured, record.bad, flights.failed)
    levels = {
        level_name(level): interval.in_sense(record.bad)
        for level, interval in zip(LEVELS, quantiles(values, LEVELS), strict=True)
    }
    flown = np.where(flights.failed | np.isnan(measured), -np.inf, values)
    worst = int(np.argmax(flown))
    if not np.isfinite(flown[worst]):
        return ControllerMetric(levels, None, None)
    return ControllerMetric(levels, float(measured[worst]), int(flights.flight[worst]))


def _unsettled(results: FlownCampaign, record: Metric) -> str | None:
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
