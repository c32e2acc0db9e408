"""Figure that plots the exceedance of limits against stability margins, flight by flight."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc.topics.figure_style import (
    LIMIT,
    MARKERS,
    controller_colors,
    legend_below,
    new_panels,
    styled,
)
from abhv_mc.topics.margins import Margins
from abhv_mc.topics.missed_requirements import failed_anyhow
from abhv_mc.topics.topic import Drawn, FigureText, Names

_MOST_POINTS = 1000  # maximum number of points per controller


def draw(margins: Margins, names: Names) -> Iterator[Drawn]:
    """Yield the figure of exceedance against margins, if margins of flights were computed."""
    if not margins.flights:
        return
    required = bool(names.requirements)
    limit_name = "limit of any requirement" if required else "median of any leading metric"
    text = FigureText(
        "margins",
        "Margins against failure",
        f"Each mark shows one flight's exceedance of the {limit_name}, in percent, against its "
        "smallest gain and phase margin. "
        + (
            "Filled marks are failures; marks at the upper end are early terminations."
            if required
            else "Filled marks are early terminations."
        ),
    )
    yield (
        text,
        plot_margins(margins, names, f"exceedance (% of {'limit' if required else 'median'})"),
    )


@styled
def plot_margins(margins: Margins, names: Names, label: str) -> Figure:
    """Plot exceedance of limits against gain and phase margin; filled markers are failures."""
    figure, grid = new_panels(2, 2, 2.1, between=(0.3, 0.0), sharey=True)
    colors, results, points = controller_colors(names.controllers), names.results, {}
    for name in margins.flights:
        flights = results.flights[name]
        rows = np.flatnonzero(np.isfinite(flights.metrics[MARGIN_NAMES[0]]))[:_MOST_POINTS]
        failed = failed_anyhow(flights, names.requirements)[rows]
        points[name] = rows, failed, 100.0 * results.ranking.beyond[name][rows]
    finite = np.concatenate([beyond[np.isfinite(beyond)] for *_, beyond in points.values()])
    low, high = finite.min(initial=0.0), finite.max(initial=0.0)
    ceiling = high + 0.15 * (high - low or 1.0)
    across = zip(
        grid.flat,
        MARGIN_NAMES,
        ("least gain margin (dB)", "least phase margin (deg)"),
        strict=False,
    )
    for axes, margin, axis_label in across:
        for i, (name, (rows, failed, beyond)) in enumerate(points.items()):
            height = np.where(np.isfinite(beyond), beyond, ceiling)
            value = results.flights[name].metrics[margin][rows]
            style = {
                "s": 9,
                "marker": MARKERS[i % len(MARKERS)],
                "edgecolors": colors[name],
                "linewidths": 0.6,
            }
            axes.scatter(
                value[~failed], height[~failed], facecolors="none", label=names.label(name), **style
            )
            axes.scatter(value[failed], height[failed], facecolors=colors[name], **style)
        axes.axhline(0.0, **LIMIT, label="limit" if names.requirements else "median")
        axes.set_xlabel(axis_label)
    grid.flat[0].set_ylabel(label)
    legend_below(figure, grid.flat[0])
    return figure
