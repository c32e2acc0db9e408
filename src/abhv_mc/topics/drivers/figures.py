"""Tornado charts of the drivers of each error, in the unit of the metric."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from abhv_mc.topics.drivers import Drivers, MetricDrivers, Swing
from abhv_mc.topics.figure_style import (
    INK,
    MARKERS,
    controller_colors,
    legend_below,
    make_value_axis,
    new_panels,
    styled,
)
from abhv_mc.topics.formatting import spoken_name
from abhv_mc.topics.topic import Drawn, FigureText, Names

_BARS = 3  # maximum number of parameters per metric
_ROW = 0.075  # height of a bar in inches
_SHORT = 14  # maximum length of parameter names for which three panels fit side by side


@dataclass(frozen=True)
class Tornado:
    """Tornado chart of one metric: medians at both ends of its largest drivers' ranges."""

    label: str
    parameters: Sequence[str]
    # swing of each parameter under each controller; None if not significant
    swings: Sequence[Sequence[Swing | None]]
    medians: Sequence[float]  # median over all flights for each controller
    limits: Sequence[float] = ()
    unit: str = ""


def draw(drivers: Drivers, names: Names) -> Iterator[Drawn]:
    """Yield the figure that shows the drivers of the leading metrics."""
    charts = []
    for metric in names.asked:
        entries = [controller.metrics.get(metric) for controller in drivers.controllers.values()]
        record = names.metrics[metric]
        limits, unit = names.campaign.limits_of(metric), record.with_unit("").strip()
        chart = make_tornado(record.label_with_unit, entries, limits, unit)
        charts += [chart] if chart.parameters else []
    if charts:
        text = FigureText(
            "drivers",
            "Drivers of the errors",
            "Median of each metric over the tenth of the flights in which a parameter is lowest "
            "(open mark) and over the tenth in which it is highest (filled mark); the tick is the "
            "median over all flights. If both marks are on one side of the tick, the metric "
            "changes in the same direction at both ends. Effects that are not significant are "
            "omitted.",
        )
        yield text, plot_tornado(charts, {name: names.label(name) for name in drivers.controllers})


def make_tornado(
    label: str,
    entries: Sequence[MetricDrivers | None],
    limits: Sequence[float] = (),
    unit: str = "",
) -> Tornado:
    """Return a metric's tornado chart, with the largest drivers over all controllers."""
    swings = [
        {swing.parameter: swing for swing in (entry.swings if entry else ())} for entry in entries
    ]
    largest: dict[str, float] = {}
    for entry in filter(None, entries):
        sizes = [(d.parameter, abs(d.srrc[0])) for d in entry.parameters if d.driver]
        sizes += [(share.parameter, share.total) for share in entry.otherwise]
        for name, size in sizes:
            largest[name] = max(largest.get(name, 0.0), size)
    ranked = sorted(
        (name for name in largest if any(name in entry_swings for entry_swings in swings)),
        key=lambda name: -largest[name],
    )[:_BARS]
    return Tornado(
        label=label,
        parameters=[spoken_name(name) for name in ranked],
        swings=[[entry_swings.get(name) for entry_swings in swings] for name in ranked],
        medians=[entry.median if entry else np.nan for entry in entries],
        limits=limits,
        unit=unit,
    )


@styled
def plot_tornado(charts: Sequence[Tornado], labels: Mapping[str, str]) -> Figure:
    """Plot the tornado charts of all metrics.

    Each metric has a panel, each parameter a group of bars, and each controller a bar.
    """
    most = max(len(chart.parameters) for chart in charts)
    longest = max(len(name) for chart in charts for name in chart.parameters)
    columns = min(len(charts), 3 if longest <= _SHORT else 2)
    row = most * (len(labels) + 1.2) * _ROW
    beside = 0.35 + 0.065 * min(longest, 26)
    figure, grid = new_panels(
        len(charts), columns, row, between=(beside, 0.54), top=0.18, left=max(beside, 0.74)
    )
    colors = [controller_colors(labels)[name] for name in labels]
    for axes, chart in zip(grid.flat, charts, strict=False):
        _draw_panel(axes, chart, colors)
    entries = [
        Line2D([], [], color=color, linewidth=2.6, marker=MARKERS[c % len(MARKERS)], markersize=4.0)
        for c, color in enumerate(colors)
    ]
    mark: dict[str, Any] = {"color": INK, "marker": "o", "markersize": 4.0, "linestyle": "none"}
    entries += [Line2D([], [], markerfacecolor="white", **mark), Line2D([], [], **mark)]
    entries.append(Line2D([], [], **mark | {"marker": "|", "markersize": 8.0}))
    texts = [*labels.values(), "lowest tenth", "highest tenth", "median of all flights"]
    legend_below(figure, *grid.flat, more=zip(texts, entries, strict=True))
    return figure


def _draw_panel(axes: Axes, chart: Tornado, colors: Sequence[str]) -> None:
    ends = []
    step = len(colors) + 1.2
    for k, swings in enumerate(chart.swings):
        for c, (swing, color) in enumerate(zip(swings, colors, strict=True)):
            if swing is None:
                continue
            y = k * step + c
            ends += [swing.lowest, swing.highest]
            axes.plot([swing.lowest, swing.highest], [y, y], color=color, linewidth=2.6, alpha=0.6)
            axes.plot([chart.medians[c]] * 2, [y - 0.5, y + 0.5], color=color, linewidth=1.0)
            mark = MARKERS[c % len(MARKERS)]
            for value, face in ((swing.lowest, "white"), (swing.highest, color)):
                axes.plot(value, y, mark, color=color, markerfacecolor=face, markersize=3.6)
    make_value_axis(
        axes, chart.label, [np.array(ends)], limits=chart.limits, unit=chart.unit, beyond=0.3
    )
    axes.grid(visible=False, axis="y")
    positions = [k * step + (len(colors) - 1) / 2.0 for k in range(len(chart.parameters))]
    axes.set_yticks(positions, list(chart.parameters))
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(chart.parameters) * step - 1.0, -1.2)
