"""Figure of docs/explanation/claim.md: error against control effort of TLC and LQR."""

from typing import Any

import numpy as np
from fronts import ANGLES, LAWS, SEARCHES
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from abhv_mc.topics.figure_style import BLUE, INK, VERMILION, new_figure, styled

COLORS = {"tlc": BLUE, "lqr": VERMILION}
SHIPPED = {
    "tlc": ("tlc", "*", "Table 1"),
    "lqr": ("lqr", "X", "the paper's LQR weights"),
}
HEADS = ("all three angles (rms)", "angle of attack", "sideslip", "bank")
SEARCH_LINES = {1: ("-", True), 2: ("--", False)}
TICKS_X = (0.6, 0.7, 0.85, 1.0, 1.2)
TICKS_Y = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.7, 2.0, 2.5)
TICKS_WIDE = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.4)
LIMITS_X = (0.58, 1.35)
HIGHEST = 2.5  # larger values are drawn at the edge with their number


def values(design: dict[str, Any], column: int) -> np.ndarray:
    """Return (value, low, high) of the error in a column of panels."""
    return np.array(design["error"] if column == 0 else design["angles"][column - 1])


def draw_front(
    axes: Axes, designs: list[dict[str, Any]], column: int, law: str, search: int
) -> None:
    """Draw the designs of one search with their intervals."""
    usage = np.array([design["mean_usage"][0] for design in designs])
    value, low, high = np.array([values(design, column) for design in designs]).T
    line, filled = SEARCH_LINES[search]
    axes.errorbar(
        usage,
        value,
        np.maximum([value - low, high - value], 0.0),
        fmt="o" + line,
        color=COLORS[law],
        markersize=3.0,
        markerfacecolor=COLORS[law] if filled else "white",
        elinewidth=0.9,
        capsize=1.5,
        label=f"{law.upper()} within margins, search {search}",
    )


def draw_shipped(
    axes: Axes, shipped: dict[str, Any], column: int, ends: tuple[float, float]
) -> None:
    """Draw the shipped designs; those outside the panel are at its edge with their number."""
    for name, (law, marker, label) in SHIPPED.items():
        if name not in shipped:
            continue
        value, usage = values(shipped[name], column)[0], shipped[name]["mean_usage"][0]
        position = min(usage, LIMITS_X[1]), min(max(value, ends[0]), ends[1])
        axes.plot(
            *position,
            marker,
            color=COLORS[law],
            markersize=9.0 if marker == "*" else 5.0,
            markeredgecolor=INK,
            markeredgewidth=0.6,
            linestyle="none",
            clip_on=False,
            zorder=4,
            label=label,
        )
        if (usage, value) != position:
            beyond = [f"error {value:.2g}"] if value != position[1] else []
            beyond += [f"usage {usage:.2g}"] if usage != position[0] else []
            right = law == "lqr" and marker == "X"
            axes.annotate(
                ", ".join(beyond),
                position,
                (5 if right else -5, 0),
                size=5.5,
                textcoords="offset points",
                ha="left" if right else "right",
                va="bottom" if value < ends[0] else "top",
            )


def label_laws(axes: Axes, fronts: dict[str, Any]) -> None:
    """Draw the names of the laws at the ends of their fronts."""
    for law in LAWS:
        designs = [design for search in SEARCHES for design in fronts.get(f"{law} {search}", [])]
        if not designs:
            continue
        if law == "tlc":
            end, offset, alignment = (
                max(designs, key=lambda d: d["mean_usage"][0]),
                (4, -3),
                ("left", "top"),
            )
        else:
            end, offset, alignment = (
                max(designs, key=lambda d: d["mean_usage"][0]),
                (6, 2),
                ("left", "bottom"),
            )
        position = end["mean_usage"][0], end["error"][0]
        axes.annotate(law.upper(), position, offset, size=8.5, weight="bold", color=COLORS[law],
                      textcoords="offset points", ha=alignment[0], va=alignment[1],
                      zorder=8)  # fmt: skip


def panel_limits(results: dict[str, Any], column: int) -> tuple[float, float]:
    """Return the limits of the error axis in a column of panels."""
    designs = [
        d
        for vehicle_results in results.values()
        for front in vehicle_results["fronts"].values()
        for d in front
    ]
    errors = [1.0, *(values(design, column)[0] for design in designs)]
    return 0.92 * min(errors), min(1.25 * max(errors), HIGHEST)


@styled
def plot_fronts(results: dict[str, Any]) -> Figure:
    """Plot a row of panels for each vehicle and a column for each error."""
    figure = new_figure(1.95 * len(results) + 0.85)
    grid = figure.subplots(len(results), len(HEADS), sharex=True, sharey="col", squeeze=False)
    for column, title in enumerate(HEADS):
        low, high = panel_limits(results, column)
        for axes, (vehicle, vehicle_results) in zip(grid[:, column], results.items(), strict=True):
            for law in LAWS:
                for search in SEARCHES:
                    if designs := vehicle_results["fronts"].get(f"{law} {search}"):
                        draw_front(axes, designs, column, law, search)
            draw_shipped(axes, vehicle_results["shipped"], column, (low, high))
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.minorticks_off()
            axes.set_xticks(TICKS_X, [f"{tick:g}" for tick in TICKS_X])
            ticks = [
                tick
                for tick in (TICKS_Y if high < 6.0 * low else TICKS_WIDE)
                if low <= tick <= high
            ]
            axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
            axes.set_xlim(*LIMITS_X)
            axes.set_ylim(low, high)
            axes.axhline(1.0, color=INK, linewidth=0.5, linestyle=":")
            references = np.array(vehicle_results["table_1"]["errors"])[ANGLES]
            axes.set_title(
                f"{title}, 1 = {references[column - 1]:.2g} deg" if column else title, fontsize=7.5
            )
            if column == 0:
                axes.set_ylabel(f"{vehicle}\nerror / Table 1's")
                label_laws(axes, vehicle_results["fronts"])
            axes.tick_params(labelsize=6.5)
    for axes in grid[-1]:
        axes.set_xlabel("control usage / Table 1's")
    entries: dict[str, Any] = {}
    for axes in grid.ravel():
        handles, labels = axes.get_legend_handles_labels()
        entries.update(dict(zip(labels, handles, strict=True)))
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=3, fontsize=6.8
    )
    return figure
