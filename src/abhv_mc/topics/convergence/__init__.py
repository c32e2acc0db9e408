"""How each number of a report settled as flights came in."""

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
from abhv_mc.topics.missed_requirements import requirement_failures
from abhv_mc.topics.names import Names
from abhv_mc.topics.plain import level_name
from abhv_mc.topics.section import (
    Cell,
    Fold,
    Item,
    Picture,
    Row,
    Section,
    Table,
    Text,
    grouped,
    interval_cell,
)
from abhv_mc.topics.topic import Topic, figures_of

_FEWEST = 100  # flights of a figure: of fewer, the intervals are wider than what settles
_PARTS = {0.25: "A quarter", 0.5: "Half", 1.0: "All flights"}  # of the flights, in the table


@dataclass(frozen=True)
class Settling:
    """An estimate and its 95 % interval after so many flights, [look]; open ends are infinite."""

    value: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True)
class ControllerSettling:
    """All estimates of one controller."""

    flights: tuple[int, ...]  # [look]
    metrics: Mapping[str, Mapping[str, Settling]]  # metric -> level
    requirements: tuple[Settling, ...]  # shares of failures


@dataclass(frozen=True)
class Convergence:
    """Quantiles of every metric and failures of every requirement against the number of flights, in flight order."""

    controllers: Mapping[str, ControllerSettling]

    @property
    def is_drawn(self) -> bool:
        """Return whether there are enough flights for a figure."""
        return any(max(one.flights, default=0) >= _FEWEST for one in self.controllers.values())


def compute_convergence(results: FlownCampaign) -> Convergence:
    """The traces of every controller."""
    return Convergence({name: _of(results, name) for name in results.controllers})


def _of(results: FlownCampaign, controller: str) -> ControllerSettling:
    flights = results.flights[controller]
    counts = looks(flights.flight.size)
    metrics = {}
    for metric in results.metrics:
        traces = quantile_traces(severities(flights, metric), counts)
        bad = flights.records[metric].bad
        metrics[metric] = {
            level_name(level): _settling(t, bad) for level, t in zip(LEVELS, traces, strict=True)
        }
    missed = (requirement_failures(flights, item) for item in results.campaign.requirements)
    shares = tuple(_settling(failure_trace(failed, counts)) for failed in missed)
    return ControllerSettling(tuple(counts), metrics, shares)


def _settling(trace: Iterable[Interval], bad: Sense = "high") -> Settling:
    found = [one.in_sense(bad) for one in trace]
    return Settling(
        *(tuple(getattr(one, part) for one in found) for part in ("value", "low", "high"))
    )


def _section(found: Convergence, names: Names) -> Section:
    words = "How each statistic converged. `report.json` holds these curves for every metric and requirement."
    if not found.is_drawn:
        words = f"A figure of how each statistic converged takes {_FEWEST} flights; `report.json` holds the curves."
    table = Table(
        "Estimates as flights came in",
        ("Quantile", names.campaign.kind.capitalize(), *_PARTS.values()),
        tuple(_groups(found, names)),
        caption="Estimates as flights came in, with 95 % intervals",
    )
    items: list[Item] = [Text(words), Picture("convergence")]
    items += [table] if table.groups else []
    return Section("How sure", (Fold("How the numbers settled", tuple(items)),))


def _groups(found: Convergence, names: Names) -> Iterator[tuple[Row, ...]]:
    """Yield the rows of each metric that stands first: a quarter, half and all of each controller's flights."""
    for metric in names.asked:
        level, words = settled_level(found, metric)
        rows = []
        for name, part in found.controllers.items():
            trace = part.metrics[metric][level]
            counts = np.array(part.flights)
            if not counts.size:
                continue
            looks = [int(np.abs(counts - share * counts[-1]).argmin()) for share in _PARTS]
            estimates = (Interval(trace.value[k], trace.low[k], trace.high[k]) for k in looks)
            rows.append((Cell(names.label(name)), *map(interval_cell, estimates)))
        if rows:
            yield grouped(
                rows, Cell(f"{names.metrics[metric].label_with_unit}, {words}", head=True)
            )


def settled_level(found: Convergence, metric: str) -> tuple[str, str]:
    """Return the quantile that every controller reached, by its name in the model and in words."""
    tables = (part.metrics[metric] for part in found.controllers.values())
    reached = all(bool(np.isfinite(table["q95"].value[-1:]).all()) for table in tables)
    return ("q95", "95 % quantile") if reached else ("q50", "median")


CONVERGENCE = Topic(
    "convergence", Convergence, compute_convergence, _section, figures=figures_of(__name__)
)
