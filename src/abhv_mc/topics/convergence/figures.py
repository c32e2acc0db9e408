"""How the numbers settled as flights came in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator, ScalarFormatter

from abhv_mc.array_types import Floats
from abhv_mc.topics.figure_style import label_lowest, legend_below, new_panels, styled


@dataclass(frozen=True)
class ConvergencePanel:
    """One number of each controller against flights."""

    label: str
    flights: Mapping[str, Floats]
    series: Mapping[str, Floats]  # controller -> [look, (value, low, high)], NaN where unbounded


@styled
def plot_convergence(
    panels: Sequence[ConvergencePanel], labels: Mapping[str, str], colors: Mapping[str, str]
) -> Figure:
    """Each number after so many flights, with its 95 % interval."""
    figure, grid = new_panels(len(panels), min(3, len(panels)), 1.2, between=(0.5, 0.75), top=0.4)
    for axes, panel in zip(grid.flat, panels, strict=False):
        for name, table in panel.series.items():
            value, low, high = table.T
            bounded = np.isfinite(low) & np.isfinite(high)
            flights = panel.flights[name]
            axes.fill_between(flights, low, high, where=bounded, color=colors[name], alpha=0.22, linewidth=0)
            axes.plot(flights, value, color=colors[name], label=labels[name])
        axes.set_xscale("log")
        _ticks(axes, np.concatenate(list(panel.flights.values())))
        axes.set_title(panel.label, fontsize=8)
    label_lowest(grid, len(panels), "flights")
    legend_below(figure, grid.flat[0])
    return figure


def _ticks(axes: Axes, flights: Floats) -> None:
    """Round numbers of flights inside the range, not too many."""
    candidates = [step * 10**power for power in range(7) for step in (1, 2, 5)]
    inside = [c for c in candidates if flights.min() <= c <= flights.max()]
    inside = [c for c in inside if str(c)[0] == "1"] if len(inside) > 6 else inside
    axes.xaxis.set_major_locator(FixedLocator(inside))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(ScalarFormatter())
    axes.xaxis.set_minor_formatter(NullFormatter())
