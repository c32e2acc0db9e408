"""Chance of PASS against the true failure rate, before a campaign flies."""

from typing import TYPE_CHECKING

from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from abhv_mc.topics.figure_style import (
    BLUE,
    GREEN,
    INK,
    VERMILION,
    label_lowest,
    legend_below,
    new_panels,
    styled,
)

if TYPE_CHECKING:
    from abhv_mc.report.numbers.planned import Planned

_COLORS = (BLUE, VERMILION, GREEN)  # of the planned flights, twice and four times as many


@styled
def plot_planned(planned: "Planned") -> Figure:
    """One panel a requirement, and one for all of them together where there are several."""
    rates, entries = planned.rates_over_allowed, planned.requirements
    count = len(entries) + (len(entries) > 1)
    figure, grid = new_panels(count, min(2, count), 1.7, between=(0.3, 0.55), sharex=True, sharey=True)
    for axes, entry in zip(grid.flat, entries, strict=False):
        for chance, color in zip(entry.pass_chance, _COLORS, strict=True):
            axes.plot(rates, chance.at_some_flight, color=color, label=f"at some flight up to {chance.runs}")
            axes.plot(rates, chance.at_runs, color=color, linestyle=(0, (5, 1.5)), label=f"at {chance.runs}")
        axes.axhline(entry.risk_used, color=INK, linewidth=0.8, linestyle=(0, (1, 1)), label="consumer's risk")
        axes.set_title(f"{entry.words} in {100.0 * entry.probability:g} %", fontsize=8)
    if len(entries) > 1:
        axes = grid.flat[len(entries)]
        for joint, color in zip(planned.together, _COLORS, strict=True):
            band = joint.at_some_flight
            axes.fill_between(rates, band.low, band.high, color=color, alpha=0.25, linewidth=0)
        axes.set_title("all requirements PASS at some flight (bounds)", fontsize=8)
    for axes in grid.flat[:count]:
        axes.axvline(1.0, color=INK, linewidth=0.8)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    for row in grid:
        row[0].set_ylabel("chance of PASS")
    label_lowest(grid, count, "true failure rate over the allowed one")
    legend_below(figure, grid.flat[0])
    return figure
