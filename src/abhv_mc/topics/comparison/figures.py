"""Figures of tracking error against control effort, and of paired differences."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from abhv_mc.array_types import Floats
from abhv_mc.topics.comparison.model import Comparison, total_usage, usage_metrics
from abhv_mc.topics.figure_style import (
    INK,
    LOG_AXIS,
    MARKERS,
    REFERENCE,
    controller_colors,
    distribution_steps,
    draw_limits,
    label_shares,
    legend_below,
    line_look,
    log_if_wide,
    mark_look,
    new_panels,
    styled,
    title_panel,
    wrap,
)
from abhv_mc.topics.formatting import significant
from abhv_mc.topics.metrics.figures import Spread
from abhv_mc.topics.topic import Drawn, FigureText, Names
from abhv_mc.topics.verdicts.model import GlanceRow, compute_verdicts

_MOST_POINTS = 250  # maximum number of plotted flights per controller
_TRADES = 3  # maximum number of panels per row, and of metrics in a campaign without requirements
# quantile levels of the differences at which the axis ends, so that outliers are cut off
_ENDS = (0.005, 0.995)


def draw(_found: Comparison, names: Names) -> Iterator[Drawn]:
    """Yield figures of metrics over two varied entries, and against control effort."""
    variants = {n: m.groups() for n in names.controllers if (m := re.fullmatch(_TWO_ENTRIES, n))}
    if len({(base, x, y) for base, x, _, y, _ in variants.values()}) == 1:
        yield _VARIANTS, plot_variants(variants, compute_verdicts(names.results).glance)
    results, records = names.results, names.metrics
    errors = [metric for metric in names.asked if records[metric].group == "tracking"]
    errors = list(names.asked) if names.requirements else errors[:_TRADES]
    flights = {name: results.flights[name] for name in names.controllers}
    if not errors or not all(map(usage_metrics, flights.values())):
        return
    flown = {name: ~table.failed for name, table in flights.items()}
    usage = {name: total_usage(table)[flown[name]] for name, table in flights.items()}
    trades = []
    for metric in errors:
        values = {name: table.metrics[metric][flown[name]] for name, table in flights.items()}
        record, limits = records[metric], results.campaign.limits_of(metric)
        trades.append(Spread(record.label_with_unit, values, limits, record.with_unit("").strip()))
    text = FigureText(
        "error_against_usage",
        "Required metrics against control effort"
        if names.requirements
        else "Tracking error against control effort",
        f"Small marks are flights, at most {_MOST_POINTS + 2} of each controller, including the "
        "flights with the smallest and the largest value. Large marks are the medians of all "
        "flights; if medians coincide, the mark of the first controller is on top. Control effort "
        "is the root sum of squares of the rms deflections of aileron, rudder and elevator from "
        "trim.",
    )
    colors = controller_colors(names.controllers)
    yield (
        text,
        plot_error_against_usage(
            usage, trades, "control effort, rms (deg)", names.controllers, colors
        ),
    )


# name of a variant with two entries: base, key, value, key and value
_TWO_ENTRIES = r"([^+]+)\+([^+=]+)=([^+]+)\+([^+=]+)=([^+]+)"
_VARIANTS = FigureText(
    "variants",
    "Metrics and verdicts of the variants",
    "5 or 95 % quantile (the worse) over all flights, and verdict; darker: larger. A value without "
    "unit has the unit of the base.",
)


@styled
def plot_variants(variants: Mapping[str, Sequence[Any]], rows: Sequence[GlanceRow]) -> Figure:
    """Plot a heat map of each metric, with verdicts, over the values of two entries."""
    _, x_keys, x, y_keys, y = zip(*variants.values(), strict=True)
    columns, lines = list(dict.fromkeys(x)), list(dict.fromkeys(y))
    across = 2 if len(columns) < 4 else 1
    figure, grid = new_panels(len(rows), across, 0.45 * len(lines), between=(0.8, 1.0), top=0.42)
    for axes, row in zip(grid.flat, rows, strict=False):
        values = np.full((len(lines), len(columns)), np.nan)
        for name, column, line in zip(variants, x, y, strict=True):
            cell, place = row.cells[name], (columns.index(column), lines.index(line))
            value = values[place[::-1]] = cell.high if row.below else cell.low
            axes.text(*place, f"{significant(value, 3)}\n{cell.status}", ha="center", va="center")
        ends = range(len(columns)), range(len(lines))
        lowest = np.nanmin(values, initial=0.0)  # nearly equal values have nearly equal colours
        axes.pcolormesh(*ends, values, cmap="Blues", alpha=0.35, edgecolors="white", vmin=lowest)
        axes.grid(False)
        axes.set_xticks(range(len(columns)), columns)
        axes.set_yticks(range(len(lines)), lines)
        axes.set(xlabel=x_keys[0], ylabel=y_keys[0])
        is_judged = any(cell.status for cell in row.cells.values())
        title_panel(axes, f"{row.label} {row.text if is_judged else f'({row.unit})'}", color=INK)
    return figure


@styled
def plot_error_against_usage(
    usage: Mapping[str, Floats],
    trades: Sequence[Spread],
    usage_label: str,
    labels: Mapping[str, str],
    colors: Mapping[str, str],
) -> Figure:
    """Plot each flight's error against its control effort, with larger marks for medians."""
    figure, grid = new_panels(len(trades), min(_TRADES, len(trades)), 1.6, between=(0.5, 0.58))
    for axes, trade in zip(grid.flat, trades, strict=False):
        for i, (name, errors) in enumerate(trade.values.items()):
            x, y = usage[name], errors
            keep = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
            if not keep.size:
                continue
            ends = keep[[np.argmin(y[keep]), np.argmax(y[keep])]]
            few = np.union1d(keep[:: -(-keep.size // _MOST_POINTS)], ends)
            look = {
                **mark_look(i, len(trade.values), 1.5),
                "color": colors[name],
                "linestyle": "none",
            }
            face = {"markerfacecolor": "none", "markeredgewidth": 0.5} if i else {}
            axes.plot(x[few], y[few], **look, **face, alpha=0.6, rasterized=True)
            look |= {"zorder": 3.0 + look["zorder"], "clip_on": False}
            median = np.median(x[keep]), np.median(y[keep])
            # Open marks are larger than filled ones, so coinciding medians remain visible.
            if i:
                look |= {"markerfacecolor": "none", "markersize": 8.0}
                axes.plot(*median, **look | {"color": "white", "markeredgewidth": 2.8})
                look["markeredgewidth"] = 1.3
            else:
                look |= {"markersize": 6.5, "markeredgecolor": "white", "markeredgewidth": 0.6}
            axes.plot(*median, **look, label=labels[name])
        values = list(trade.values.values())
        least = min((v[np.isfinite(v)].min(initial=np.inf) for v in values), default=0.0)
        is_log = log_if_wide(axes, "y", values)
        if not is_log and least >= 0.0:
            axes.set_ylim(bottom=0.0)
        notes = [LOG_AXIS] * is_log + draw_limits(axes, "y", trade.limits, trade.unit)
        title_panel(axes, ", ".join([trade.label, *notes]))
        axes.set_xlabel(usage_label)
    spans = np.array([axes.get_xlim() for axes in grid.flat[: len(trades)]])
    for axes in grid.flat[: len(trades)]:
        axes.set_xlim(spans[:, 0].min(), spans[:, 1].max())
    more = [
        (label, Line2D([], [], color=INK, marker="o", linestyle="none", markersize=size))
        for label, size in (("flight", 2.0), ("median", 6.5))
    ]
    legend_below(figure, *grid.flat, more=more)
    return figure


@dataclass(frozen=True)
class DifferencePanel:
    """Paired differences of a metric, with their median and its interval."""

    label: str
    # pair -> one difference per flight; infinite if only one of the paired flights terminated early
    differences: Mapping[str, Floats]
    # median, and lower and upper bound of its interval; None for an infinite bound
    medians: Mapping[str, tuple[float | None, float | None, float | None]]


@styled
def plot_differences(
    panels: Sequence[DifferencePanel],
    labels: Mapping[str, str],
    colors: Mapping[str, str],
    zero: str,
) -> Figure:
    """Plot the cumulative distribution of differences, one panel per metric.

    A mark with an interval shows the median. ``zero`` is the label of the line at zero difference.
    """
    figure, grid = new_panels(
        len(panels), 3 if len(panels) > 4 else 2, 1.25, between=(0.25, 0.55), top=0.12, sharey=True
    )
    for axes, panel in zip(grid.flat, panels, strict=False):
        ends = [0.0]
        for i, (name, values) in enumerate(panel.differences.items()):
            look = {**line_look(i, len(panel.differences)), "color": colors[name]}
            axes.step(*distribution_steps(values), where="post", label=labels[name], **look)
            finite = values[np.isfinite(values)]
            ends += np.quantile(finite, _ENDS).tolist() if finite.size else []
            middle, low, high = panel.medians[name]
            if middle is not None:
                ends += [end for end in (low, middle, high) if end is not None]
                arms = [[middle - (middle if low is None else low)],
                        [(middle if high is None else high) - middle]]  # fmt: skip
                style = {"fmt": MARKERS[i % len(MARKERS)], "color": colors[name]}
                axes.errorbar(middle, 0.5, xerr=arms, **style, markersize=4.5, elinewidth=1.6)
        room = 0.06 * (max(ends) - min(ends) or 1.0)
        axes.set_xlim(min(ends) - room, max(ends) + room)
        axes.xaxis.get_major_locator().set_params(nbins=4)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.axvline(0.0, label=zero, **REFERENCE)
        axes.set_xlabel(wrap(axes, panel.label))
    label_shares(grid)
    legend_below(figure, *grid.flat)
    return figure
