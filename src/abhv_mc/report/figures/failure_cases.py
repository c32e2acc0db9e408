"""Flights after a failure: who still flies, and how."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.topics.figure_style import label_lowest, legend_below, new_panels, styled


@dataclass(frozen=True)
class CasePanel:
    """Share still flying of one case, by controller."""

    title: str
    curves: Mapping[str, Floats]  # controller -> [time]


@dataclass(frozen=True)
class CaseBand:
    """Smallest, median and largest value of a channel in one case, by controller."""

    title: str
    label: str
    bands: Mapping[str, Floats]  # controller -> [3, time]


@styled
def plot_survival(
    times: Floats, panels: Sequence[CasePanel], labels: Mapping[str, str], colors: Mapping[str, str]
) -> Figure:
    """Share still flying against the time since the failure, one panel a case."""
    figure, grid = new_panels(len(panels), min(2, len(panels)), 1.0, between=(0.3, 0.55), sharex=True, sharey=True)
    styles = ("-", "--", ":", "-.")
    for axes, panel in zip(grid.flat, panels, strict=False):
        for i, name in enumerate(labels):
            if name in panel.curves:
                share = 100.0 * panel.curves[name]
                axes.plot(times, share, color=colors[name], linestyle=styles[i % 4], label=labels[name])
        axes.set_title(panel.title, fontsize=8)
        axes.set_ylim(-3.0, 103.0)
    for axes in grid[:, 0]:
        axes.set_ylabel("still flying (%)")
    label_lowest(grid, len(panels), "time since the first failure (s)")
    legend_below(figure, *grid.flat[: len(panels)])
    return figure


@styled
def plot_bands(
    times: Floats, rows: Sequence[Sequence[CaseBand]], labels: Mapping[str, str], colors: Mapping[str, str]
) -> Figure:
    """One row a channel, one column a case."""
    columns = len(rows[0])
    figure, grid = new_panels(len(rows) * columns, columns, 1.2, between=(0.2, 0.2), sharex=True, sharey="row")
    for r, row in enumerate(rows):
        for axes, band in zip(grid[r], row, strict=True):
            for name, table in band.bands.items():
                axes.fill_between(times, table[0], table[2], color=colors[name], alpha=0.15, linewidth=0)
                axes.plot(times, table[1], color=colors[name], label=labels[name])
            axes.axvline(0.0, color="#222222", linewidth=0.5)
            if r == 0:
                axes.set_title(band.title, fontsize=8)
        grid[r, 0].set_ylabel(row[0].label)
    label_lowest(grid, len(rows) * columns, "time since the failure (s)")
    legend_below(figure, *grid.flat)
    return figure
