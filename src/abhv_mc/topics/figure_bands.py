"""Envelope figures: one column per controller, or one panel per channel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from string import ascii_lowercase
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from abhv_mc.array_types import Floats
from abhv_mc.folder.histories import MOST_MEDIAN
from abhv_mc.topics.figure_style import DASHES, INK, new_panels, put_legend, styled

# Bands from widest to narrowest: lower and upper quantile, opacity and legend text.
BANDS = (
    ("min", "max", 0.18, "all flights"),
    ("q0.135", "q99.865", 0.30, "0.135–99.865 %"),
    ("q5", "q95", 0.45, "5–95 %"),
)
_LABEL = 18  # maximum number of characters per line of a row label
SIMULTANEOUS = ("simultaneous_low", "simultaneous_high")
MEDIANS = ("q50", MOST_MEDIAN)
REFERENCE: dict[str, Any] = {"color": INK, "linewidth": 0.6, "linestyle": "-"}
LIMIT: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": (0, (4, 2))}
# position of the inset in axes coordinates: left edge, lower edge, width, height
_INSET = (0.3, 0.66, 0.69, 0.34)
_SHOWN = 3.0  # time shown in the inset before and after the largest change, s


@dataclass(frozen=True)
class EnvelopePanel:
    """Panel with one channel under one controller."""

    x: Floats  # time in s, or another abscissa
    bands: Mapping[
        str, Floats
    ]  # bands [time]: min, q0.135, q5, q50, q95, q99.865, max, also q50_most if there are unknowns
    reference: tuple[Floats, Floats] | None = None
    # curves (x, y) of individual flights, worst first
    flights: Sequence[tuple[Floats, Floats]] = ()
    levels: Sequence[float] = ()  # limits of requirements


@dataclass(frozen=True)
class EnvelopeRow:
    """Panels that share their axes, one per controller."""

    label: str  # label of the y axis, including the unit
    panels: Sequence[EnvelopePanel]
    inset: bool = False  # whether an inset enlarges the largest change


def _draw(axes: Axes, panel: EnvelopePanel, color: str) -> None:
    """Draw one panel, with the worst flight in front and thin lines for the other flights."""
    faint = 0.5 if panel.flights else 1.0
    for low, high, opacity, _ in [band for band in BANDS if band[0] in panel.bands]:
        area = panel.bands[low], panel.bands[high]
        axes.fill_between(panel.x, *area, color=color, alpha=faint * opacity, linewidth=0)
    for x, y in panel.flights[:0:-1]:
        axes.plot(x, y, color=INK, linewidth=0.35, alpha=0.6, zorder=3)
    for x, y in panel.flights[:1]:
        axes.plot(x, y, color=color, linewidth=1.5, zorder=4)
    for median in [name for name in MEDIANS if name in panel.bands and not panel.flights]:
        axes.plot(panel.x, panel.bands[median], color=color, linewidth=1.6)
    for level in panel.levels:
        axes.axhline(level, **LIMIT)
    if panel.reference is not None:
        axes.plot(*panel.reference, **REFERENCE)


def _legend(
    figure: Figure, rows: Sequence[EnvelopeRow], band_names: Sequence[str], lines: Sequence[Line2D]
) -> None:
    """Add a legend for the bands, lines and reference that are drawn."""
    panels = [panel for row in rows for panel in row.panels]
    drawn = {name for panel in panels for name in panel.bands}
    handles: list[Patch | Line2D] = [
        Patch(facecolor=INK, alpha=opacity + 0.1 * i, linewidth=0, label=label)
        for i, (low, _, opacity, label) in enumerate(BANDS)
        if low in drawn and low in band_names
    ]
    handles += lines
    if any(panel.reference is not None for panel in panels):
        handles.append(Line2D([], [], label="reference", **REFERENCE))
    put_legend(figure, handles, [str(handle.get_label()) for handle in handles])


@styled
def plot_envelopes(
    rows: Sequence[EnvelopeRow], titles: Sequence[str], colors: Sequence[str]
) -> Figure:
    """Plot rows of panels, one column per controller; the panels of a row share the y axis."""
    count = len(rows) * len(titles)
    figure, grid = new_panels(
        count, len(titles), 0.8, between=(0.2, 0.3), lettered=False, sharex="row", sharey="row"
    )
    for r, row in enumerate(rows):
        for c, panel in enumerate(row.panels):
            axes = grid[r, c]
            _draw(axes, panel, colors[c])
            if r == 0:
                axes.set_title(titles[c], color=colors[c])
            if c == 0:
                axes.set_ylabel(fill(row.label, _LABEL), va="center")
            if r == len(rows) - 1:
                axes.set_xlabel("time (s)")
        flown = np.concatenate([panel.x[np.isfinite(panel.x)] for panel in row.panels])
        if flown.size:  # No value is finite if every flight has terminated early.
            grid[r, 0].set_xlim(float(flown.min()), float(flown.max()) or 1.0)
        _set_y_limits(grid[r, 0], row)
    if any(panel.flights for row in rows for panel in row.panels):
        lines = [
            Line2D([], [], color=INK, linewidth=1.5, label="worst flight"),
            Line2D([], [], color=INK, linewidth=0.35, label="the next worst"),
        ]
        if any(panel.levels for row in rows for panel in row.panels):
            lines.append(Line2D([], [], label="limit", **LIMIT))
    else:
        two = any(MOST_MEDIAN in panel.bands for row in rows for panel in row.panels)
        lines = [
            Line2D(
                [], [], color=INK, linewidth=1.6, label="least and most median" if two else "median"
            )
        ]
    _legend(figure, rows, [low for low, *_ in BANDS], lines)
    return figure


@styled
def plot_sheet(
    rows: Sequence[EnvelopeRow], labels: Mapping[str, str], colors: Mapping[str, str]
) -> Figure:
    """Plot one panel per channel with each controller's full range, 5 to 95 % band and median."""
    figure, grid = new_panels(len(rows), 3, 1.3, between=(0.4, 0.42), top=0.24, lettered=False)
    looks = [(colors[name], DASHES[i % len(DASHES)]) for i, name in enumerate(labels)]
    for k, (axes, row) in enumerate(zip(grid.flat, rows, strict=False)):
        _overlay(axes, row, looks)
        letter = ascii_lowercase[k : k + 1] if len(rows) > 1 else ""
        axes.set_title(f"{letter}  {row.label}".strip(), loc="left", fontweight="normal")
        _set_y_limits(axes, row)
        if row.inset:
            _draw_inset(axes, row, looks)
        if k >= len(rows) - 3:
            axes.set_xlabel("time (s)")
    lines = [
        Line2D([], [], color=color, linestyle=dash, label=name.replace("$", r"\$"))
        for name, (color, dash) in zip(labels.values(), looks, strict=True)
    ]
    _legend(figure, rows, ("min", "q5"), lines)
    return figure


def _overlay(axes: Axes, row: EnvelopeRow, looks: Sequence[tuple[str, Any]]) -> None:
    for k, (panel, (color, dash)) in enumerate(zip(row.panels, looks, strict=True)):
        on_top = 1.0 - k / len(looks)  # The first controller is drawn on top.
        for low, high, opacity, _ in [band for band in BANDS[::2] if band[0] in panel.bands]:
            area = panel.bands[low], panel.bands[high]
            axes.fill_between(
                panel.x, *area, color=color, alpha=0.6 * opacity, linewidth=0, zorder=1.0 + on_top
            )
        for median in [name for name in MEDIANS if name in panel.bands]:
            curve = panel.x, panel.bands[median]
            axes.plot(*curve, color=color, linestyle=dash, linewidth=1.0, zorder=2.0 + on_top)
        for edge in [name for name in SIMULTANEOUS if name in panel.bands]:
            curve = panel.x, panel.bands[edge]
            axes.plot(*curve, color=color, linestyle=":", linewidth=0.8, zorder=2.0 + on_top)
    if row.panels[0].reference is not None:
        axes.plot(*row.panels[0].reference, **REFERENCE)


def _draw_inset(axes: Axes, row: EnvelopeRow, looks: Sequence[tuple[str, Any]]) -> None:
    """Add an inset above the curves that enlarges the time around the largest change."""
    peaks = []
    for panel in row.panels:
        middle = np.nanmedian(panel.bands["q50"])
        most = np.fmax.reduce([np.abs(band - middle) for band in panel.bands.values()])
        peaks.append((float(np.nanmax(most)), float(panel.x[np.nanargmax(most)])))
    start, end = row.panels[0].x[0], row.panels[0].x[-1]
    if end - start < 4.0 * _SHOWN:
        return
    center = float(np.clip(max(peaks)[1], start + _SHOWN, end - _SHOWN))
    low, high = axes.get_ylim()
    axes.set_yticks([tick for tick in MaxNLocator(4).tick_values(low, high) if low <= tick <= high])
    axes.set_ylim(low, high + 0.75 * (high - low))
    inset = axes.inset_axes(_INSET)
    _overlay(inset, row, looks)
    inset.set_xlim(center - _SHOWN, center + _SHOWN)
    _set_y_limits(inset, row)
    inset.set_xticks([float(np.ceil(center - _SHOWN)), float(np.floor(center + _SHOWN))])
    inset.locator_params(axis="y", nbins=2)
    inset.tick_params(length=2, pad=1)


def _set_y_limits(axes: Axes, row: EnvelopeRow) -> None:
    """Set the y limits to the values within the x range, plus a margin."""
    low, high = np.inf, -np.inf
    left, right = axes.get_xlim()
    for panel in row.panels:
        curves = [*((panel.x, band) for band in panel.bands.values()), *panel.flights]
        curves += [panel.reference] if panel.reference is not None else []
        for x, y in curves:
            inside = y[(x >= left) & (x <= right) & np.isfinite(y)]
            if inside.size:
                low, high = min(low, float(inside.min())), max(high, float(inside.max()))
        low, high = min([low, *panel.levels]), max([high, *panel.levels])
    if not np.isfinite(high - low):
        return
    margin = 0.06 * (high - low) or max(1e-3 * abs(high), 1e-6)
    axes.set_ylim(low - margin, high + margin)


def off_reference(x: Floats, y: Floats, time: Floats, reference: Floats | None) -> Floats:
    """Return a channel minus its reference [time], if there is one; ``x`` is the time, s."""
    return y if reference is None else y - np.interp(x, time, reference)


def bands_off(
    x: Floats, bands: Mapping[str, Floats], time: Floats, reference: Floats | None
) -> dict[str, Floats]:
    """Return a channel's bands minus its reference [time], if there is one.

    The minimum and maximum cover all control ticks between two samples. Both are omitted if the
    reference varies, because its change between samples would appear as an error.
    """
    moves = reference is not None and float(np.ptp(reference)) > 0.0
    drawn_bands = {
        name: band for name, band in bands.items() if not (moves and name in ("min", "max"))
    }
    return {name: off_reference(x, band, time, reference) for name, band in drawn_bands.items()}
