"""Margins of flights, and whether flights of small margin are those that fail."""

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.topics.figure_style import INK, MARKERS, controller_colors, legend_below, new_panels, styled
from abhv_mc.topics.margins.model import Margins, Marks
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import FigureText

_MOST_POINTS = 1000  # of a controller


def draw(margins: Margins, names: Names) -> Iterator[tuple[FigureText, Figure]]:
    """How bad each flight is over its margins, where flights have them."""
    marks = {name: entry.marks for name, entry in margins.flights.items() if entry.marks is not None}
    if not marks:
        return
    required = margins.required
    words = "limit of any requirement" if required else "median of any metric asked for"
    text = FigureText(
        "margins",
        "Margins against failure",
        f"Each mark is one flight: how far it is beyond the {words}, in units of its size, "
        "over its least gain and phase margin. "
        + ("Filled marks failed; marks at the upper end ended early." if required else "Filled marks ended early."),
    )
    yield text, plot_margins(marks, f"beyond a {'limit' if required else 'median'} (units of it)", names)


@styled
def plot_margins(marks: Mapping[str, Marks], worst_label: str, names: Names) -> Figure:
    """How bad each flight is against its least gain and phase margin; filled marks are flights that failed."""
    colors = controller_colors(tuple(names.controllers))
    figure, grid = new_panels(2, 2, 2.1, between=(0.3, 0.0), sharey=True)
    finite = np.concatenate([each.beyond[np.isfinite(each.beyond)] for each in marks.values()])
    low, high = float(finite.min(initial=0.0)), float(finite.max(initial=0.0))
    ceiling = high + 0.15 * (high - low or 1.0)
    panels = zip(
        grid.flat, ("gain_db", "phase_deg"), ("least gain margin (dB)", "least phase margin (deg)"), strict=True
    )
    for axes, key, label in panels:
        for i, (name, each) in enumerate(marks.items()):
            height = np.where(np.isfinite(each.beyond), each.beyond, ceiling)[:_MOST_POINTS]
            across, failed = getattr(each, key)[:_MOST_POINTS], each.failed[:_MOST_POINTS]
            marker = MARKERS[i % len(MARKERS)]
            style = {"s": 9, "marker": marker, "edgecolors": colors[name], "linewidths": 0.6}
            axes.scatter(across[~failed], height[~failed], facecolors="none", label=names.label(name), **style)
            axes.scatter(across[failed], height[failed], facecolors=colors[name], **style)
        axes.axhline(0.0, color=INK, linewidth=0.7, linestyle="--")
        axes.set_xlabel(label)
    grid.flat[0].set_ylabel(worst_label)
    legend_below(figure, grid.flat[0])
    return figure
