"""How each number of a report settled as flights came in."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from abhv_mc.folder.controller_flights import severities
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.convergence import Trace, failure_trace, looks, quantile_traces
from abhv_mc.statistics.estimates import LEVELS
from abhv_mc.topics.failed_flights import requirement_failures
from abhv_mc.topics.names import Names
from abhv_mc.topics.plain import level_name
from abhv_mc.topics.section import FigureText, Fold, Picture, Section, Text
from abhv_mc.topics.topic import Drawn, Topic

if TYPE_CHECKING:
    from abhv_mc.topics.convergence.figures import ConvergencePanel


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


def compute_convergence(results: FlownCampaign) -> Convergence:
    """The traces of every controller."""
    return Convergence({name: _of(results, name) for name in results.controllers})


def _of(results: FlownCampaign, controller: str) -> ControllerSettling:
    flights = results.flights[controller]
    counts = looks(flights.flight.size)
    metrics = {}
    for metric in results.metrics:
        traces = quantile_traces(severities(flights, metric), counts)
        low = flights.records[metric].bad == "low"
        metrics[metric] = {
            level_name(level): _settling(trace, low) for level, trace in zip(LEVELS, traces, strict=True)
        }
    missed = (requirement_failures(flights, item) for item in results.campaign.requirements)
    shares = tuple(_settling(failure_trace(failed, counts)) for failed in missed)
    return ControllerSettling(tuple(counts.tolist()), metrics, shares)


def _settling(trace: Trace, turned: bool = False) -> Settling:
    value, low, high = (np.array(ends, float) for ends in (trace.value, trace.low, trace.high))
    if turned:
        value, low, high = -value, -high, -low
    return Settling(*(tuple(each.tolist()) for each in (value, low, high)))


def _panels(found: Convergence, names: Names) -> "Iterator[ConvergencePanel]":
    """One a metric that stands first, of what was reached by every controller."""
    from abhv_mc.topics.convergence.figures import ConvergencePanel

    for metric in names.asked:
        tables = {name: part.metrics[metric] for name, part in found.controllers.items()}
        reached = all(np.isfinite(table["q95"].value[-1]) for table in tables.values())
        level, words = ("q95", "95 % quantile") if reached else ("q50", "median")
        chosen = {name: table[level] for name, table in tables.items()}
        series = {name: np.array([each.value, each.low, each.high]).T for name, each in chosen.items()}
        series = {name: np.where(np.isfinite(each), each, np.nan) for name, each in series.items()}
        if not all(np.isnan(each[:, 0]).all() for each in series.values()):
            flights = {name: np.array(part.flights, float) for name, part in found.controllers.items()}
            yield ConvergencePanel(f"{names.metrics[metric].label_with_unit}\n{words}", flights, series)


def _figures(found: Convergence, names: Names) -> Iterator[Drawn]:
    from abhv_mc.topics.convergence.figures import plot_convergence
    from abhv_mc.topics.figure_style import controller_colors

    panels = list(_panels(found, names))
    if any(table.shape[0] > 1 for panel in panels for table in panel.series.values()):
        text = FigureText(
            "convergence",
            "How the numbers settled",
            "The 95 % quantile of each error (the median where more than 5 % of its flights ended early) "
            "after so many flights, in flight order, with its exact 95 % interval where the flights bound it on both "
            "sides.",
        )
        yield text, plot_convergence(panels, names.controllers, controller_colors(tuple(names.controllers)))


def _section(found: Convergence, _names: Names) -> Section:
    words = "How each statistic converged. `report.json` holds these curves for every metric and requirement."
    if all(len(part.flights) < 2 for part in found.controllers.values()):
        words = "Too few flights to show how the numbers settled."
    return Section("How sure", (Fold("How the numbers settled", (Text(words), Picture("convergence"))),))


CONVERGENCE = Topic("convergence", Convergence, compute_convergence, _section, figures=_figures)
