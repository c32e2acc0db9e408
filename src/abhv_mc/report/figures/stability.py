"""Margins of flights, and whether flights of small margin are those that fail."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.topics.figure_style import INK, MARKERS, legend_below, new_panels, styled

_MOST_POINTS = 1000  # of a controller


@dataclass(frozen=True)
class MarginMarks:
    """The flights of one controller."""

    gain_db: Floats  # [flight]
    phase_deg: Floats
    worst: Floats  # [flight] distance beyond any limit; infinite where the flight ended early
    failed: NDArray[np.bool_]


@styled
def plot_margins(
    marks: Mapping[str, MarginMarks], worst_label: str, labels: Mapping[str, str], colors: Mapping[str, str]
) -> Figure:
    """How bad each flight is against its least gain and phase margin; filled marks are flights that failed."""
    figure, grid = new_panels(2, 2, 2.1, between=(0.3, 0.0), sharey=True)
    finite = np.concatenate([each.worst[np.isfinite(each.worst)] for each in marks.values()])
    low, high = float(finite.min(initial=0.0)), float(finite.max(initial=0.0))
    ceiling = high + 0.15 * (high - low or 1.0)
    panels = zip(
        grid.flat, ("gain_db", "phase_deg"), ("least gain margin (dB)", "least phase margin (deg)"), strict=True
    )
    for axes, key, label in panels:
        for i, (name, each) in enumerate(marks.items()):
            height = np.where(np.isfinite(each.worst), each.worst, ceiling)[:_MOST_POINTS]
            across, failed = getattr(each, key)[:_MOST_POINTS], each.failed[:_MOST_POINTS]
            marker = MARKERS[i % len(MARKERS)]
            style = {"s": 9, "marker": marker, "edgecolors": colors[name], "linewidths": 0.6}
            axes.scatter(across[~failed], height[~failed], facecolors="none", label=labels[name], **style)
            axes.scatter(across[failed], height[failed], facecolors=colors[name], **style)
        axes.axhline(0.0, color=INK, linewidth=0.7, linestyle="--")
        axes.set_xlabel(label)
    grid.flat[0].set_ylabel(worst_label)
    legend_below(figure, grid.flat[0])
    return figure
