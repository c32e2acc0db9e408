"""Figures of docs/explanation/tuning.md."""

import numpy as np
from experiment import Floats
from matplotlib.figure import Figure
from tuning_flights import FACTORS, HEADS, MANY, SWING

from abhv_mc.topics.figure_style import CYCLE, new_figure, styled


@styled
def plot_sensitivities(results: dict[str, list[tuple[Floats, int] | None]]) -> Figure:
    """Plot errors over the factor on each bandwidth."""
    figure = new_figure(5.2)
    grid = figure.subplots(2, 3, sharex=True, sharey=True)
    for i, (axes, title) in enumerate(zip(grid.ravel(), HEADS, strict=False)):
        for j, (channel, flown) in enumerate(results.items()):
            base = flown[FACTORS.index(1.0)]
            ratios = [flight[0][i] / base[0][i] if flight and base else np.nan for flight in flown]
            style = ("-", "--")[j // len(CYCLE) % 2]
            axes.plot(
                FACTORS, ratios, style, color=CYCLE[j % len(CYCLE)], label=channel.replace("_", " ")
            )
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(FACTORS, [f"{factor:.2g}" for factor in FACTORS])
        axes.set_yticks((0.25, 0.5, 1.0, 2.0, 4.0), ("0.25", "0.5", "1", "2", "4"))
        axes.minorticks_off()
        axes.set_title(f"{title.rsplit(' ', 1)[0]} error")
    for axes in grid[-1]:
        axes.set_xlabel("bandwidth over Table 1's")
    for axes in grid[:, 0]:
        axes.set_ylabel("rms over Table 1's")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=6.5)
    return figure


@styled
def plot_differentiators(curves: dict[float, list[tuple[float, int]]]) -> Figure:
    """Plot swings over the bandwidth of sub-loop 3's differentiator."""
    figure = new_figure(2.4, 5.0)
    axes = figure.subplots()
    for color, (ratio, points) in zip(CYCLE, curves.items(), strict=False):
        x, y = np.array([point for point in points if point[0] > 0.0]).T
        axes.plot(x, y, "o-", color=color, markersize=3.0, label=f"sub-loop 4 at {ratio:g} times")
    axes.axhline(MANY, color="black", linewidth=0.7, linestyle=":")
    axes.axvline(0.3, color="black", linewidth=0.7, linestyle="--")
    axes.set_xscale("log")
    axes.margins(0.05, 0.1)
    axes.set_xlabel("differentiator of sub-loop 3 (rad/s); dashed: the paper's")
    axes.set_ylabel(f"swings over {SWING:g} deg")
    figure.legend(loc="outside upper center", ncols=3)
    return figure
