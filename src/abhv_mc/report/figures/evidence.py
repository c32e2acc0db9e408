"""What drives a metric, and how the numbers settled as flights came in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator, ScalarFormatter
from numpy.typing import NDArray

from abhv_mc.report.figures.style import INK, MARKERS, new_figure, styled

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class DriverPanel:
    """Coefficients of the parameters on one metric."""

    title: str
    parameters: Sequence[str]  # largest first
    coefficients: Mapping[str, Floats]  # controller -> [parameter, (value, low, high)]
    drivers: Mapping[str, NDArray[np.bool_]]  # controller -> [parameter] whether it is one


@styled
def plot_drivers(panels: Sequence[DriverPanel], labels: Mapping[str, str], colors: Mapping[str, str]) -> Figure:
    """Standardized rank regression coefficients with their intervals; hollow where chance can explain them."""
    longest = max(len(name) for panel in panels for name in panel.parameters)
    columns = min(len(panels), 3 if longest <= 16 else 2)
    rows = -(-len(panels) // columns)
    most = max(len(panel.parameters) for panel in panels)
    figure = new_figure(0.5 + rows * (0.6 + 0.17 * most * max(1.0, len(labels) / 2.0)))
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True)
    for axes, panel in zip(grid.flat, panels, strict=False):
        place = np.arange(len(panel.parameters))
        for i, (name, table) in enumerate(panel.coefficients.items()):
            shift = (i - (len(panel.coefficients) - 1) / 2.0) * 0.22
            value, low, high = table.T
            for j in place:
                axes.errorbar(
                    value[j],
                    j + shift,
                    xerr=[[max(value[j] - low[j], 0.0)], [max(high[j] - value[j], 0.0)]],
                    fmt=MARKERS[i % len(MARKERS)],
                    markersize=3.5,
                    color=colors[name],
                    markerfacecolor=colors[name] if panel.drivers[name][j] else "white",
                    elinewidth=0.9,
                    label=labels[name] if j == 0 else None,
                )
        axes.axvline(0.0, color=INK, linewidth=0.6)
        axes.set_yticks(place, panel.parameters)
        axes.set_ylim(len(panel.parameters) - 0.5, -0.5)
        axes.set_xlim(-1.05, 1.05)
        axes.set_title(panel.title, fontsize=8, loc="left")
        axes.grid(visible=False, axis="y")
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes in grid.flat[max(0, len(panels) - columns) : len(panels)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("SRRC")
    handles, words = grid.flat[0].get_legend_handles_labels()
    figure.legend(handles, words, loc="outside lower center", ncols=len(words))
    return figure


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
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure = new_figure(0.4 + 1.7 * rows)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True)
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
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes in grid.flat[max(0, len(panels) - columns) : len(panels)]:
        axes.set_xlabel("flights")
        axes.tick_params(labelbottom=True)
    handles, words = grid.flat[0].get_legend_handles_labels()
    figure.legend(handles, words, loc="outside lower center", ncols=len(words))
    return figure


def _ticks(axes, flights: Floats) -> None:  # type: ignore[no-untyped-def]
    """Round numbers of flights inside the range, not too many."""
    candidates = [step * 10**power for power in range(7) for step in (1, 2, 5)]
    inside = [c for c in candidates if flights.min() <= c <= flights.max()]
    inside = [c for c in inside if str(c)[0] == "1"] if len(inside) > 6 else inside
    axes.xaxis.set_major_locator(FixedLocator(inside))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(ScalarFormatter())
    axes.xaxis.set_minor_formatter(NullFormatter())
