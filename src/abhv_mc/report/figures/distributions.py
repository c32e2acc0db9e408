"""How the metrics of the controllers are spread, and what tracking costs in control."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter

from abhv_mc.array_types import Floats
from abhv_mc.topics.figure_style import INK, MARKERS, distribution_steps, legend_below, new_panels, styled

_MOST_POINTS = 1000  # of a controller in a scatter plot


@dataclass(frozen=True)
class Spread:
    """One metric of every controller."""

    label: str
    values: Mapping[str, Floats]  # controller -> [flight]; infinite where the flight failed
    limits: Sequence[float] = field(default=())  # of requirements


def _log_if_wide(axes: Axes, way: Literal["x", "y"], values: Sequence[Floats]) -> bool:
    """Make an axis logarithmic where all but the smallest values span more than 20 to 1."""
    finite = np.concatenate([v[np.isfinite(v)] for v in values])
    if not finite.size or finite.min() <= 0.0:
        return False
    low, high = float(np.quantile(finite, 0.02)), float(finite.max())
    if high <= 20.0 * low:
        return False
    axis = axes.xaxis if way == "x" else axes.yaxis
    axes.set(**{f"{way}scale": "log"})
    subs = (1.0, 2.0, 5.0) if high < 50.0 * low else (1.0, 3.0) if high < 500.0 * low else (1.0,)
    axis.set_major_locator(LogLocator(base=10.0, subs=subs, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
    return True


@styled
def plot_distributions(spreads: Sequence[Spread], labels: Mapping[str, str], colors: Mapping[str, str]) -> Figure:
    """Share of flights at or below each value, one panel a metric, one line a controller."""
    columns = 3 if len(spreads) > 4 else 2
    figure, grid = new_panels(len(spreads), columns, 1.2, between=(0.25, 0.55), top=0.12, sharey=True)
    dashes = ("-", (0, (5, 1.5)), (0, (1.5, 1)), (0, (5, 1, 1, 1)))
    for axes, spread in zip(grid.flat, spreads, strict=False):
        for i, (name, values) in enumerate(spread.values.items()):
            look = {"color": colors[name], "linestyle": dashes[i % 4], "label": labels[name]}
            axes.step(*distribution_steps(values), where="post", **look)
        if _log_if_wide(axes, "x", list(spread.values.values())):
            finite = np.concatenate(list(spread.values.values()))
            axes.set_xlim(left=0.5 * float(np.quantile(finite[np.isfinite(finite)], 0.02)))
        far = []
        for limit in spread.limits:
            low, high = axes.get_xlim()
            if low - 0.5 * (high - low) <= limit <= high + 0.5 * (high - low):
                axes.axvline(limit, color=INK, linewidth=0.8, linestyle=(0, (1, 1)), label="required limit")
            else:
                far.append(f"limit {limit:g} {'right' if limit > high else 'left'} of here")
        axes.set_xlabel("\n".join([spread.label, *far]))
        axes.set_ylim(-0.02, 1.02)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    for row in grid:
        row[0].set_ylabel("share of flights")
    legend_below(figure, *grid.flat)
    return figure


@dataclass(frozen=True)
class Trade:
    """One tracking error of every controller."""

    label: str
    errors: Mapping[str, Floats]  # controller -> [flight]


@styled
def plot_error_against_usage(
    usage: Mapping[str, Floats],
    trades: Sequence[Trade],
    usage_label: str,
    labels: Mapping[str, str],
    colors: Mapping[str, str],
) -> Figure:
    """Each flight as a point: how far it strayed against how much it moved its surfaces; medians marked large."""
    figure, grid = new_panels(len(trades), len(trades), 2.0, top=0.12, sharex=True)
    for axes, trade in zip(grid[0], trades, strict=True):
        for i, (name, errors) in enumerate(trade.errors.items()):
            x, y = usage[name], errors
            keep = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
            if not keep.size:
                continue
            marker = MARKERS[i % len(MARKERS)]
            few = keep[:: max(1, keep.size // _MOST_POINTS)]
            small = {"markersize": 1.6, "alpha": 0.35, "markeredgewidth": 0, "rasterized": True}
            large = {"markersize": 7, "markeredgecolor": "white", "label": labels[name], "zorder": 5}
            axes.plot(x[few], y[few], marker, color=colors[name], **small)
            axes.plot(np.median(x[keep]), np.median(y[keep]), marker, color=colors[name], **large)
        if not _log_if_wide(axes, "y", list(trade.errors.values())):
            axes.set_ylim(bottom=0.0)
        axes.set_xlabel(usage_label)
        axes.set_ylabel(trade.label)
    legend_below(figure, grid[0, 0])
    return figure
