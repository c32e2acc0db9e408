"""One failing flight beside the nominal one and beside the flight with nothing but what makes it fail."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from abhv_mc.report.figures.style import BLUE, INK, VERMILION, new_figure, pad_if_flat, styled

Floats = NDArray[np.float64]

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
    rows = -(-len(panels) // 2)
    figure = new_figure(0.7 + 1.5 * rows)
    figure.suptitle(title, fontsize=8.5)
    grid = figure.subplots(rows, 2, squeeze=False, sharex=True)
    for axes, panel in zip(grid.flat, panels, strict=False):
        for curve, label, look in zip(panel.curves, labels, _LOOKS, strict=True):
            _draw(axes, time, curve, label, look)
        axes.set_ylabel(panel.label)
        pad_if_flat(axes)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel("time (s)")
    handles, words = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, words, loc="outside lower center", ncols=len(words))
    return figure


def _draw(axes, time: Floats, curve: Floats, label: str, look: Mapping[str, object]) -> None:  # type: ignore[no-untyped-def]
    axes.plot(time, curve, label=label, **look)
    flown = np.flatnonzero(np.isfinite(curve))
    if flown.size and flown[-1] < time.size - 1:
        axes.plot(time[flown[-1]], curve[flown[-1]], "x", color=look["color"], markersize=5)
