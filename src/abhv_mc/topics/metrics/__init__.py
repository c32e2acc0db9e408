"""Report topic: quantiles and worst value of every metric for every controller."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from abhv_mc.flights.metrics import Metric
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.estimates import LEVELS, Interval, quantiles, severity
from abhv_mc.topics.formatting import level_name, significant
from abhv_mc.topics.topic import (
    Cell,
    Fold,
    Names,
    Picture,
    Row,
    Section,
    Table,
    Text,
    Topic,
    figures_of,
    grouped,
    interval_cell,
)

SMALL_IS_BAD = "small is bad"


@dataclass(frozen=True)
class ControllerMetric:
    """Statistics of one metric for one controller."""

    # quantiles by level, with 95 % intervals; early terminations count as the worst
    quantiles: Mapping[str, Interval]
    worst: float | None  # worst value among completed flights; None if no flight completed
    worst_flight: int | None


@dataclass(frozen=True)
class MetricTable:
    """Statistics of one metric for every controller."""

    words: Mapping[str, str]  # printed names and units
    # name of the same metric with transients, if this metric excludes transients
    same_as: str | None
    controllers: Mapping[str, ControllerMetric]


@dataclass(frozen=True)
class Metrics:
    """All metrics, with the names of the leading and of the compared metrics."""

    asked: tuple[str, ...]
    compared: tuple[str, ...]
    table: Mapping[str, MetricTable]


def compute_metrics(results: FlownCampaign) -> Metrics:
    """Return the statistics of every metric."""
    records = results.campaign.metrics
    table = {
        metric: MetricTable(
            records[metric].as_texts(),
            _unsettled(results, records[metric]),
            {
                name: metric_statistics(results.flights[name], metric, records[metric])
                for name in results.controllers
            },
        )
        for metric in results.metrics
    }
    return Metrics(results.asked, results.compared, table)


def metric_statistics(flights: ControllerFlights, metric: str, record: Metric) -> ControllerMetric:
    """Return the quantiles and the worst value of one controller's metric."""
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
    plain = replace(record, name="", doc="", label="", settled=False)
    for other in map(
        results.campaign.metrics.__getitem__, results.metrics if record.settled else ()
    ):
        if replace(other, name="", doc="", label="") == plain and all(
            np.array_equal(
                flights.metrics[record.name], flights.metrics[other.name], equal_nan=True
            )
            for flights in results.flights.values()
        ):
            return other.name
    return None


GROUPS = {
    "asked": "Required metrics",
    "tracking": "Tracking errors",
    "usage": "Control effort",
    "loads": "Loads and validity",
    "stability": "Stability margins",
    "user": "Metrics of this campaign",
}
_HEADS = ("Median", "95 %", "99.73 %", "Worst", "Flight")


def metric_section(metrics: Metrics, names: Names) -> Section:
    """Return the section on metrics: first the required metrics, then groups of metrics."""
    text = (
        "The tables list quantiles over the flights with exact 95 % intervals (order statistics), "
        "with as many digits as the number of flights allows, and the worst flight. If small "
        'values are bad, quantiles are counted from below. "Not reached" means that more flights '
        "terminated early than lie beyond the quantile. `metrics.csv` has all metrics; the printed "
        "page has only the required metrics."
    )
    if not names.campaign.independent:
        text += " The intervals are not exact, because the flights are not independent."
    return Section(
        "Error distributions", (Text(text), Picture("distribution_asked"), *_folds(metrics, names))
    )


def _folds(metrics: Metrics, names: Names) -> Iterator[Fold]:
    for group, title in GROUPS.items():
        listed = []
        for metric, table in metrics.table.items():
            own = "asked" if metric in names.asked else table.words["group"]
            if own == group and (group == "asked" or not table.same_as):
                listed.append(_rows(table, names))
        if listed:
            yield Fold(title, (Table(title, ("Metric", names.kind, *_HEADS), tuple(listed)),))


def _rows(table: MetricTable, names: Names) -> tuple[Row, ...]:
    texts, rows = table.words, []
    for name, entry in table.controllers.items():
        flight = "\N{EM DASH}" if entry.worst_flight is None else str(entry.worst_flight)
        levels = map(interval_cell, entry.quantiles.values())
        worst = map(Cell, (significant(entry.worst, 4), flight))
        rows.append((Cell(names.label(name), head=True), *levels, *worst))
    note = SMALL_IS_BAD if texts["bad"] == "low" else ""
    return grouped(rows, Cell(texts["label_with_unit"], note, head=True, hint=texts["doc"]))


METRICS = Topic("metrics", Metrics, compute_metrics, metric_section, figures=figures_of(__name__))
