"""Which share of each error's variance a parameter causes, alone and with the others."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from abhv_mc.report.figures.style import INK, MARKERS, new_figure, styled

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SobolPanel:
    """Indices of the parameters on one metric."""

    title: str
    parameters: Sequence[str]  # largest first
    first: Mapping[str, Floats]  # controller -> [parameter, (value, low, high)]
    total: Mapping[str, Floats]  # likewise


@styled
def plot_sobol(panels: Sequence[SobolPanel], labels: Mapping[str, str], colors: Mapping[str, str]) -> Figure:
    """First-order indices as filled marks, total ones as hollow marks, with their intervals."""
    longest = max(len(name) for panel in panels for name in panel.parameters)
    columns = min(len(panels), 3 if longest <= 16 else 2)
    rows = -(-len(panels) // columns)
    most = max(len(panel.parameters) for panel in panels)
    figure = new_figure(0.5 + rows * (0.6 + 0.17 * most * max(1.0, len(labels) / 2.0)))
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True)
    lowest, highest = -0.05, 1.0
    for axes, panel in zip(grid.flat, panels, strict=False):
        place = np.arange(len(panel.parameters))
        for i, name in enumerate(panel.total):
            shift = (i - (len(panel.total) - 1) / 2.0) * 0.26
            for table, face in ((panel.total[name], "white"), (panel.first[name], colors[name])):
                value, low, high = table.T
                axes.errorbar(
                    value,
                    place + shift,
                    xerr=[np.maximum(value - low, 0.0), np.maximum(high - value, 0.0)],
                    fmt=MARKERS[i % len(MARKERS)],
                    markersize=4.0,
                    color=colors[name],
                    markerfacecolor=face,
                    elinewidth=0.9,
                )
        axes.axvline(0.0, color=INK, linewidth=0.6)
        axes.set_yticks(place, panel.parameters)
        axes.set_ylim(len(panel.parameters) - 0.5, -0.5)
        ends = np.concatenate([table.ravel() for table in (*panel.first.values(), *panel.total.values())])
        lowest, highest = min(lowest, float(ends.min())), max(highest, float(ends.max()))
        axes.set_title(panel.title, fontsize=8, loc="left")
        axes.grid(visible=False, axis="y")
    grid.flat[0].set_xlim(lowest - 0.05, highest + 0.05)  # of all: noise takes ends past 0 and 1
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes in grid.flat[max(0, len(panels) - columns) : len(panels)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("share of the variance")
    handles = [
        Line2D([], [], color=colors[name], marker=MARKERS[i % len(MARKERS)], linestyle="none", label=labels[name])
        for i, name in enumerate(labels)
    ]
    handles.append(Line2D([], [], color=INK, marker="o", linestyle="none", label="alone (first order)"))
    handles.append(
        Line2D([], [], color=INK, marker="o", markerfacecolor="white", linestyle="none", label="with others (total)")
    )
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure
