"""One failing flight beside the nominal one and beside the flight with nothing but what makes it fail."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.topics.figure_style import (
    BLUE,
    INK,
    VERMILION,
    label_lowest,
    legend_below,
    new_panels,
    pad_if_flat,
    styled,
)

_LOOKS = (
    {"color": INK, "linewidth": 1.0, "linestyle": (0, (4, 2))},
    {"color": VERMILION, "linewidth": 1.5},
    {"color": BLUE, "linewidth": 0.9},
)


@dataclass(frozen=True)
class ExplainedPanel:
    """One channel of the flights."""

    label: str
    curves: Sequence[Floats]  # nominal, with the causes alone, as flown: [time], NaN after the end


@styled
def plot_explained(
    title: str, time: Floats, until: float, panels: Sequence[ExplainedPanel], labels: Sequence[str]
) -> Figure:
    """Channels over time up to ``until`` seconds, two columns; a cross marks where a flight ended early."""
    shown = time <= until
    panels = [ExplainedPanel(panel.label, [curve[shown] for curve in panel.curves]) for panel in panels]
    time = time[shown]
    figure, grid = new_panels(len(panels), 2, 1.2, between=(0.68, 0.2), top=0.6, sharex=True)
    figure.suptitle(title, fontsize=8.5)
    for axes, panel in zip(grid.flat, panels, strict=False):
        for curve, label, look in zip(panel.curves, labels, _LOOKS, strict=True):
            _draw(axes, time, curve, label, look)
        axes.set_ylabel(panel.label)
        pad_if_flat(axes)
    label_lowest(grid, len(panels), "time (s)")
    legend_below(figure, grid[0, 0])
    return figure


def _draw(axes: Axes, time: Floats, curve: Floats, label: str, look: Mapping[str, Any]) -> None:
    axes.plot(time, curve, label=label, **look)
    flown = np.flatnonzero(np.isfinite(curve))
    if flown.size and flown[-1] < time.size - 1:
        axes.plot(time[flown[-1]], curve[flown[-1]], "x", color=look["color"], markersize=5)
