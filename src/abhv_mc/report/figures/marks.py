"""How much each parameter counts for a metric, with intervals: rank coefficients and Sobol indices."""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.report.figures.style import INK, MARKERS, label_lowest, new_panels, put_legend, styled

_LETTERS = 24  # of a name in a line
Marks = Sequence[tuple[Floats, NDArray[np.bool_]]]  # ([parameter, (value, low, high)], [parameter] whether filled)


@dataclass(frozen=True)
class MarksPanel:
    """One metric: the marks of each controller for each parameter."""

    title: str
    parameters: Sequence[str]  # largest first
    marks: Mapping[str, Marks]  # controller -> marks


@styled
def plot_marks(
    panels: Sequence[MarksPanel],
    labels: Mapping[str, str],
    colors: Mapping[str, str],
    x_label: str,
    limits: tuple[float, float],
    meanings: tuple[str, str] | None = None,
) -> Figure:
    """Marks with their intervals, filled or hollow; ``meanings`` says what filled and hollow are.

    The x axis spans ``limits``, or more where an interval ends outside.
    """
    names = [[textwrap.fill(name, _LETTERS) for name in panel.parameters] for panel in panels]
    lines = [line for panel in names for name in panel for line in name.split("\n")]
    longest = max(map(len, lines))
    columns = min(len(panels), 3 if longest <= 16 else 2)
    most = max(len(panel.parameters) for panel in panels)
    wrapped = any("\n" in name for panel in names for name in panel)
    height, room = most * max(0.15, 0.075 * len(labels), 0.25 * wrapped), 0.2 + 0.062 * longest
    figure, grid = new_panels(len(panels), columns, height, room, (room, 0.48), sharex=True)
    lowest, highest = limits
    for axes, panel, words in zip(grid.flat, panels, names, strict=False):
        place = np.arange(len(panel.parameters))
        for i, (name, marks) in enumerate(panel.marks.items()):
            shift = (i - (len(panel.marks) - 1) / 2.0) * 0.24
            for table, filled in marks:
                known = np.isfinite(table)
                lowest = np.min(table - 0.05, where=known, initial=lowest)
                highest = np.max(table + 0.05, where=known, initial=highest)
                for rows, face in ((~filled, "white"), (filled, colors[name])):
                    value, low, high = table[rows].T
                    axes.errorbar(
                        value,
                        place[rows] + shift,
                        xerr=[np.fmax(value - low, 0.0), np.fmax(high - value, 0.0)],
                        fmt=MARKERS[i % len(MARKERS)],
                        markersize=3.8,
                        color=colors[name],
                        markerfacecolor=face,
                        elinewidth=0.9,
                    )
        axes.axvline(0.0, color=INK, linewidth=0.6)
        axes.set_yticks(place, words)
        axes.set_ylim(len(panel.parameters) - 0.5, -0.5)
        axes.set_title(panel.title, fontsize=8, loc="left")
        axes.grid(visible=False, axis="y")
    grid.flat[0].set_xlim(lowest, highest)
    label_lowest(grid, len(panels), x_label)
    looks = [(labels[name], MARKERS[i % len(MARKERS)], colors[name], colors[name]) for i, name in enumerate(labels)]
    looks += [(word, "o", INK, face) for word, face in zip(meanings or (), (INK, "white"), strict=False)]
    handles = [
        Line2D([], [], color=color, marker=marker, markerfacecolor=face, linestyle="none", label=label)
        for label, marker, color, face in looks
    ]
    put_legend(figure, handles, [str(handle.get_label()) for handle in handles])
    return figure
