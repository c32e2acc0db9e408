"""Report topic: convergence of the estimates as the number of flights grows."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from abhv_mc.folder.controller_flights import severities
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.estimates import (
    LEVELS,
    Interval,
    Sense,
    failure_trace,
    looks,
    quantile_traces,
)
from abhv_mc.topics.formatting import level_name
from abhv_mc.topics.missed_requirements import requirement_failures
from abhv_mc.topics.topic import (
    Cell,
    Fold,
    Item,
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

# minimum number of flights for a figure; with fewer flights, the intervals hide the trend
_FEWEST = 100
# fractions of the flights for which the table has a row
_PARTS = {0.25: "A quarter", 0.5: "Half", 1.0: "All flights"}


@dataclass(frozen=True)
class Settling:
    """Estimate and 95 % interval by number of flights [check]; open bounds are infinite."""

    value: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True)
class ControllerSettling:
    """Convergence of all estimates for one controller."""

    flights: tuple[int, ...]  # number of flights at each check [check]
    metrics: Mapping[str, Mapping[str, Settling]]  # quantiles by metric and level
    requirements: tuple[Settling, ...]  # convergence of the failure rate for each requirement


@dataclass(frozen=True)
class Convergence:
    """Convergence of the leading metrics' quantiles and the requirements' failure rates.

    Each estimate includes all flights up to a flight number.
    """

    controllers: Mapping[str, ControllerSettling]

    @property
    def is_drawn(self) -> bool:
        """Return whether there are enough flights to draw a figure."""
        return any(
            max(estimates.flights, default=0) >= _FEWEST for estimates in self.controllers.values()
        )


def compute_convergence(results: FlownCampaign) -> Convergence:
    """Return the convergence of every controller's estimates."""
    return Convergence({name: _of(results, name) for name in results.controllers})


def _of(results: FlownCampaign, controller: str) -> ControllerSettling:
    flights = results.flights[controller]
    counts = looks(flights.flight.size)
    metrics = {}
    for metric in results.asked:
        traces = quantile_traces(severities(flights, metric), counts)
        bad = flights.records[metric].bad
        metrics[metric] = {
            level_name(level): _settling(t, bad) for level, t in zip(LEVELS, traces, strict=True)
        }
    missed = (requirement_failures(flights, item) for item in results.campaign.requirements)
    return ControllerSettling(
        tuple(counts), metrics, tuple(_settling(failure_trace(failed, counts)) for failed in missed)
    )


def _settling(trace: Iterable[Interval], bad: Sense = "high") -> Settling:
    estimates = [interval.in_sense(bad) for interval in trace]
    return Settling(
        *(
            tuple(getattr(interval, bound) for interval in estimates)
            for bound in ("value", "low", "high")
        )
    )


def _section(convergence: Convergence, names: Names) -> Section:
    text = (
        "The table and figure show how estimates converge. `report.json` contains the curves of "
        "the leading metrics and the requirements."
        if convergence.is_drawn
        else f"The convergence figure requires at least {_FEWEST} flights; `report.json` contains "
        "the curves."
    )
    table = Table(
        "Estimates by number of flights",
        ("Quantile", names.kind, *_PARTS.values()),
        tuple(_groups(convergence, names)),
        caption="Estimates by number of flights, with 95 % intervals",
    )
    items: tuple[Item, ...] = (Text(text), Picture("convergence"), *[table] * bool(table.groups))
    return Section("Statistical confidence", (Fold("Convergence", items),))


def _groups(convergence: Convergence, names: Names) -> Iterator[tuple[Row, ...]]:
    """Yield table rows for each leading metric after a quarter, half and all of the flights."""
    for metric in names.asked:
        level, quantile_name = settled_level(convergence, metric)
        rows = []
        for name, estimates_of in convergence.controllers.items():
            trace = estimates_of.metrics[metric][level]
            counts = np.array(estimates_of.flights)
            if not counts.size:
                continue
            looks = [int(np.abs(counts - share * counts[-1]).argmin()) for share in _PARTS]
            estimates = (Interval(trace.value[k], trace.low[k], trace.high[k]) for k in looks)
            rows.append((Cell(names.label(name)), *map(interval_cell, estimates)))
        if rows:
            yield grouped(
                rows, Cell(f"{names.metrics[metric].label_with_unit}, {quantile_name}", head=True)
            )


def settled_level(convergence: Convergence, metric: str) -> tuple[str, str]:
    """Return the key and printed name of a quantile that is available for all controllers."""
    tables = (trace.metrics[metric] for trace in convergence.controllers.values())
    is_reached = all(bool(np.isfinite(table["q95"].value[-1:]).all()) for table in tables)
    return ("q95", "95 % quantile") if is_reached else ("q50", "median")


CONVERGENCE = Topic(
    "convergence", Convergence, compute_convergence, _section, figures=figures_of(__name__)
)
