"""Figures of searches, of single and nominal flights, and of planned campaigns."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from abhv_mc.array_types import Floats
from abhv_mc.report.numbers.pass_chances import Planned
from abhv_mc.topics.figure_style import (
    BLUE,
    CYCLE,
    DASHES,
    GREEN,
    INK,
    LIMIT,
    MARKERS,
    PERCENT,
    SKY,
    VERMILION,
    label_lowest,
    legend_below,
    new_figure,
    new_panels,
    pad_if_flat,
    styled,
    title_panel,
)  # fmt: skip

_ROW = 0.22  # height of a parameter's row, inches
# The first flight after the nominal flight has the most visible colour.
_FLIGHT_COLORS = (CYCLE[1], CYCLE[0], *CYCLE[2:])
# channel, axis label and scale of each panel that shows individual flights
FLIGHT_PANELS = (
    ("altitude_m", "altitude (km)", 1e-3),
    ("speed_mps", "speed (m/s)", 1.0),
    ("angle_of_attack_deg", "angle of attack (deg)", 1.0),
    ("sideslip_deg", "sideslip (deg)", 1.0),
    ("bank_deg", "bank (deg)", 1.0),
    ("elevator_deg", "elevator (deg)", 1.0),
    ("aileron_deg", "aileron (deg)", 1.0),
    ("rudder_deg", "rudder (deg)", 1.0),
)


@styled
def plot_convergence(
    label: str,
    searched: Floats,
    random: Floats,
    stages: Sequence[tuple[int, str]],
    limits: Sequence[float] = (),
) -> Figure:
    """Plot the worst value so far in a search and in random flights.

    ``stages`` contains the first flight and the name of each stage of the search.
    """
    figure = new_figure(2.8)
    axes = figure.subplots()
    axes.plot(
        np.arange(1, random.size + 1),
        random,
        color=INK,
        linestyle=DASHES[2],
        label="random, same box",
    )
    axes.plot(
        np.arange(1, searched.size + 1), searched, color=VERMILION, linewidth=1.5, label="search"
    )
    for limit in limits:
        axes.axhline(limit, label="limit", **LIMIT)
    for i, (start, name) in enumerate(stages):
        axes.axvline(start, color=SKY, linewidth=0.6)
        anchor = start, 1.02 + 0.08 * (i % 2)
        axes.annotate(name, anchor, xycoords=("data", "axes fraction"), fontsize=6.5, va="bottom")
    axes.set_ylabel(f"worst so far:\n{label}")
    pad_if_flat(axes)
    axes.set_xlabel("flights")
    legend_below(figure, axes)
    return figure


@styled
def plot_worst_point(names: Sequence[str], position: Floats, change: Floats, label: str) -> Figure:
    """Plot the worst case's position (-1 to 1) in each range, and the change of the metric.

    ``change`` [parameter, 2] is the change of the metric if the parameter decreases or increases.
    """
    figure = new_figure(0.9 + _ROW * len(names) * 1.3)
    left, right = figure.subplots(1, 2, sharey=True)
    rows = np.arange(len(names))
    left.hlines(rows, -1.0, 1.0, color=INK, alpha=0.3, linewidth=1.0)
    left.plot(position, rows, "o", color=VERMILION, markersize=5)
    left.set_yticks(rows, names)
    left.set_ylim(len(names) - 0.5, -0.5)
    left.set_xlim(-1.1, 1.1)
    left.set_xticks([-1.0, 0.0, 1.0], ["low end", "middle", "high end"])
    left.set_title("Position in the box")
    right.barh(rows - 0.18, change[:, 0], 0.34, color=BLUE, label="decrease by 1/20 of the range")
    right.barh(
        rows + 0.18, change[:, 1], 0.34, color=VERMILION, label="increase by 1/20 of the range"
    )
    right.axvline(0.0, color=INK, linewidth=0.6)
    right.set_xlabel(f"change of {label}")
    right.set_title("Sensitivity at the worst case")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def _line_of(repetition: int) -> dict[str, Any]:
    """Return the line style of a repetition."""
    color, marker = CYCLE[repetition % len(CYCLE)], MARKERS[repetition % len(MARKERS)]
    return {"color": color, "marker": marker, "markersize": 4, "linewidth": 0.9}


@styled
def plot_levels(label: str, limit: float, repetitions: Sequence[tuple[Floats, Floats]]) -> Figure:
    """Plot each repetition's thresholds and the probabilities of exceeding them."""
    figure = new_figure(2.8)
    axes = figure.subplots()
    for i, (thresholds, probabilities) in enumerate(repetitions):
        axes.semilogy(thresholds, probabilities, label=f"repetition {i + 1}", **_line_of(i))
    axes.axvline(limit, label="limit", **LIMIT)
    axes.set_xlabel(label)
    axes.set_ylabel("exceedance probability")
    figure.legend(loc="outside right upper")
    return figure


@styled
def plot_learning(label: str, limits: Sequence[float], steps: Floats, values: Floats) -> Figure:
    """Plot a probability with its interval by number of flights, and the metric by flight.

    Each row of ``steps`` [step, 5] contains the number of flights, the probabilities from two
    Gaussian processes, and the lower and upper bounds of the interval.
    """
    figure = new_figure(2.6)
    left, right = figure.subplots(1, 2)
    flights, first, second, low, high = np.where(steps > 0.0, steps, np.nan).T
    least = np.nanmin(steps[:, 1:], where=steps[:, 1:] > 0.0, initial=1.0)
    left.fill_between(
        flights, np.nan_to_num(low, nan=0.1 * least), high, color="#DDDDDD", label="interval"
    )
    left.semilogy(flights, first, "o-", color=BLUE, markersize=3, label="Matern process")
    left.semilogy(flights, second, "s--", color=VERMILION, markersize=3, label="smooth process")
    left.set_ylabel("probability of a failure")
    right.plot(np.arange(values.size), values, ".", color=BLUE, markersize=4, label="flight")
    for limit in limits:
        right.axhline(limit, label="limit", **LIMIT)
    right.set_ylabel(label)
    for axes in (left, right):
        axes.set_xlabel("flights")
    legend_below(figure, left, right)
    return figure


@styled
def plot_mixing(acceptance: Sequence[Floats], spread: Sequence[Floats], target: float) -> Figure:
    """Plot the acceptance rate, its target and the move size at each level except the first."""
    figure = new_figure(2.4)
    left, right = figure.subplots(1, 2)
    for i, (rates, sizes) in enumerate(zip(acceptance, spread, strict=True)):
        levels = np.arange(2, rates.size + 2)
        left.plot(levels, rates, **_line_of(i))
        right.plot(levels, sizes, **_line_of(i))
    left.axhline(target, **LIMIT)
    for axes, label in ((left, "accepted moves"), (right, "size of a move (1: independent)")):
        axes.set_xlabel("level")
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.set_ylabel(label)
        axes.set_ylim(0.0, 1.05)
    return figure


@styled
def plot_failures(names: Sequence[str], points: Floats) -> Figure:
    """Plot parameter quantiles in standard normal space, for failures and for all flights."""
    figure = new_figure(0.8 + _ROW * len(names) * 1.2)
    axes = figure.subplots()
    rows = np.arange(len(names))
    axes.axvspan(-1.96, 1.96, color=INK, alpha=0.1, linewidth=0, label="95 % of all flights")
    low, q25, median, q75, high = np.quantile(points, [0.025, 0.25, 0.5, 0.75, 0.975], axis=0)
    axes.hlines(rows, low, high, color=BLUE, linewidth=1.0, label="95 % of failures")
    axes.hlines(rows, q25, q75, color=BLUE, linewidth=4.0, label="half of failures")
    axes.plot(median, rows, "o", color=VERMILION, markersize=4, label="their median")
    axes.set_yticks(rows, names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel("parameter in standard deviations (transformed to a normal distribution)")
    figure.legend(loc="outside lower center", ncols=4)
    return figure


@styled
def plot_flights(
    times: Floats,
    panels: Mapping[str, Floats],
    labels: Sequence[str],
    title: str = "",
    limits: Sequence[float] = (),
) -> Figure:
    """Plot channels [flight, time], in which row 0 is the nominal flight (dash-dotted).

    Values after the end of a flight are NaN; a cross marks the end. ``limits`` are drawn in the
    first panel.
    """
    figure, grid = new_panels(
        len(panels),
        2,
        1.2,
        between=(0.68, 0.2),
        top=0.24 + 0.18 * bool(title) * (1 + title.count("\n")),
        sharex=True,
    )
    figure.suptitle(title, fontsize=8.5)
    for axes, (label, curves) in zip(grid.flat, panels.items(), strict=False):
        for i, (curve, name) in enumerate(zip(curves, labels, strict=True)):
            style: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": DASHES[3]}
            if i:
                style = {
                    "color": _FLIGHT_COLORS[(i - 1) % len(_FLIGHT_COLORS)],
                    "linewidth": 1.5 if i == 1 else 0.9,
                }
            axes.plot(times, curve, label=name, **style)
            recorded = np.flatnonzero(np.isfinite(curve))
            if recorded.size and recorded[-1] < times.size - 1:
                end = times[recorded[-1]], curve[recorded[-1]]
                axes.plot(*end, "x", color=style["color"], markersize=5)
        axes.set_ylabel(label)
        pad_if_flat(axes)
    for limit in limits:
        grid[0, 0].axhline(limit, label="limit", **LIMIT)
    label_lowest(grid, len(panels), "time (s)")
    legend_below(figure, grid[0, 0])
    return figure


# colours for 1, 2 and 4 times the planned number of flights
_PLANNED = (BLUE, VERMILION, GREEN)


@styled
def plot_planned(planned: Planned) -> Figure:
    """Plot the chance of PASS against the true failure rate.

    The figure has one panel for each requirement, and one for all requirements jointly.
    """
    rates, entries = planned.rates_over_allowed, planned.requirements
    count = len(entries) + (len(entries) > 1)
    figure, grid = new_panels(
        count, min(2, count), 1.7, between=(0.3, 0.55), sharex=True, sharey=True
    )
    for axes, entry in zip(grid.flat, entries, strict=False):
        for chance, color in zip(entry.pass_chance, _PLANNED, strict=True):
            label = f"at some flight up to {chance.runs}"
            axes.plot(rates, chance.at_some_flight, color=color, label=label)
            dashed = {"linestyle": (0, (5, 1.5)), "label": f"at {chance.runs}"}
            axes.plot(rates, chance.at_runs, color=color, **dashed)
        dotted = {"linewidth": 0.8, "linestyle": (0, (1, 1)), "label": "consumer's risk"}
        axes.axhline(entry.risk_used, color=INK, **dotted)
        title_panel(axes, f"{entry.words} in {100.0 * entry.probability:g} %")
    if len(entries) > 1:
        axes = grid.flat[len(entries)]
        for joint, color in zip(planned.together, _PLANNED, strict=True):
            band = joint.at_some_flight
            axes.fill_between(rates, band.low, band.high, color=color, alpha=0.25, linewidth=0)
        title_panel(axes, "PASS of all requirements at some flight (bounds)")
    for axes in grid.flat[:count]:
        axes.axvline(1.0, color=INK, linewidth=0.8)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=PERCENT))
    for row in grid:
        row[0].set_ylabel("chance of PASS")
    label_lowest(grid, count, "true failure rate / allowed failure rate")
    legend_below(figure, grid.flat[0])
    return figure
