"""Envelope figures: one column per controller, or one panel per channel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from abhv_mc.array_types import Floats, Mask
from abhv_mc.folder.histories import MOST_MEDIAN
from abhv_mc.topics.figure_style import (
    INK,
    LIMIT,
    REFERENCE,
    WIDTH,
    line_look,
    new_panels,
    put_legend,
    styled,
    title_panel,
)

# Bands from widest to narrowest: lower and upper quantile, opacity and legend text.
BANDS = (
    ("min", "max", 0.18, "all flights"),
    ("q0.135", "q99.865", 0.30, "0.135–99.865 %"),
    ("q5", "q95", 0.45, "5–95 %"),
)
_LABEL = 18  # maximum number of characters per line of a row label
_SHORT = 14  # maximum number of characters per line of a label of a small panel
SIMULTANEOUS = ("simultaneous_low", "simultaneous_high")
_SIMULTANEOUS_LINE: dict[str, Any] = {"linestyle": ":", "linewidth": 0.8}
MEDIANS = ("q50", MOST_MEDIAN)
# style of the shading where no limit applies to a channel
_EXCLUDED: dict[str, Any] = {"color": INK, "alpha": 0.13, "linewidth": 0}
_NEXT_WORST: dict[str, Any] = {"color": INK, "linewidth": 0.35, "alpha": 0.45}
# style of the shading of the period that an inset enlarges
_ENLARGED: dict[str, Any] = {"color": INK, "alpha": 0.08, "linewidth": 0}
# position of the inset in axes coordinates: left edge, lower edge, width, height
_INSET = (0.3, 0.66, 0.69, 0.34)
_SHOWN = 3.0  # time in s that the inset shows before and after the largest change


@dataclass(frozen=True)
class EnvelopePanel:
    """Panel with one channel under one controller."""

    x: Floats  # time in s, or another abscissa
    # bands [time]: min, q0.135, q5, q50, q95, q99.865, max; with unknowns, also q50_most
    bands: Mapping[str, Floats]
    reference: tuple[Floats, Floats] | None = None
    # curves (x, y) of individual flights, worst first
    flights: Sequence[tuple[Floats, Floats]] = ()
    # limits of requirements as curves (x, y), which are NaN where a limit does not apply
    limits: Sequence[tuple[Floats, Floats]] = ()

    @property
    def excluded(self) -> tuple[Floats, Mask] | None:
        """Times, and a mask of times at which no limit applies; None if a limit always applies."""
        if not self.limits:
            return None
        time = self.limits[0][0]
        mask = np.all([np.isnan(level) for _, level in self.limits], axis=0)
        return (time, mask) if mask.any() else None


@dataclass(frozen=True)
class EnvelopeRow:
    """Panels that share their axes, one per controller."""

    label: str  # label of the y axis, including the unit
    panels: Sequence[EnvelopePanel]
    inset: bool = False  # whether an inset enlarges the largest change
    across: str = "time (s)"  # label of the x axis


def _draw(axes: Axes, panel: EnvelopePanel, color: str) -> None:
    """Draw one panel, with the worst flight in front and thin lines for the other flights."""
    faint = 0.5 if panel.flights else 1.0
    for low, high, opacity, _ in [band for band in BANDS if band[0] in panel.bands]:
        area = panel.bands[low], panel.bands[high]
        axes.fill_between(panel.x, *area, color=color, alpha=faint * opacity, linewidth=0)
    for x, y in panel.flights[:0:-1]:
        axes.add_artist(Line2D(x, y, **_NEXT_WORST, zorder=3))  # The limits are set later.
    for x, y in panel.flights[:1]:
        axes.plot(x, y, color=color, linewidth=1.5, zorder=4)
    for median in [name for name in MEDIANS if name in panel.bands and not panel.flights]:
        axes.plot(panel.x, panel.bands[median], color=color, linewidth=1.6)
    for time, level in panel.limits:
        axes.plot(time, level, **LIMIT)
    if panel.excluded is not None:
        time, mask = panel.excluded
        axes.fill_between(
            time, 0.0, 1.0, where=mask, transform=axes.get_xaxis_transform(), **_EXCLUDED
        )
    if panel.reference is not None:
        axes.plot(*panel.reference, **REFERENCE)


def _legend(
    figure: Figure,
    rows: Sequence[EnvelopeRow],
    band_names: Sequence[str],
    lines: Sequence[Patch | Line2D],
) -> None:
    """Add a legend for the lines, bands and references in the figure."""
    panels = [panel for row in rows for panel in row.panels]
    drawn = {name for panel in panels for name in panel.bands}
    handles = list(lines)
    handles += [
        Patch(facecolor=INK, alpha=opacity + 0.1 * i, linewidth=0, label=label)
        for i, (low, _, opacity, label) in enumerate(BANDS)
        if low in drawn and low in band_names
    ]
    if any(SIMULTANEOUS[0] in panel.bands for panel in panels):
        handles.append(Line2D([], [], label="simultaneous 95 %", color=INK, **_SIMULTANEOUS_LINE))
    if any(panel.reference is not None for panel in panels):
        handles.append(Line2D([], [], label="reference", **REFERENCE))
    put_legend(figure, handles, [str(handle.get_label()) for handle in handles])


@styled
def plot_envelopes(
    rows: Sequence[EnvelopeRow], titles: Sequence[str], colors: Sequence[str]
) -> Figure:
    """Plot rows of panels, one column per controller; the panels of a row share the y axis."""
    figure, grid = new_panels(
        len(rows) * len(titles), len(titles), 0.8, between=(0.2, 0.24), sharex=True, sharey="row"
    )
    for r, row in enumerate(rows):
        for c, panel in enumerate(row.panels):
            axes = grid[r, c]
            _draw(axes, panel, colors[c])
            if r == 0:
                title_panel(axes, titles[c], color=colors[c], weight="bold")
            if c == 0:
                axes.set_ylabel(fill(row.label, _LABEL), va="center")
            axes.tick_params(labelbottom=r == len(rows) - 1)
            if r == len(rows) - 1:
                axes.set_xlabel("time (s)")
    panels = [panel for row in rows for panel in row.panels]
    times = np.concatenate(
        [time for panel in panels for time in (panel.x, *(x for x, _ in panel.flights))]
    )
    times = times[np.isfinite(times)]
    if times.size:  # No value is finite if every flight has terminated early.
        grid[0, 0].set_xlim(float(times.min()), float(times.max()) or 1.0)
    for axes, row in zip(grid[:, 0], rows, strict=True):
        _set_y_limits(axes, row)
    if any(panel.flights for panel in panels):
        lines: list[Patch | Line2D] = [
            Line2D([], [], color=INK, linewidth=1.5, label="worst flight"),
            Line2D([], [], label="next worst flights", **_NEXT_WORST),
        ]
        if any(panel.limits for panel in panels):
            lines.append(Line2D([], [], label="limit", **LIMIT))
        if any(panel.excluded for panel in panels):
            lines.append(Patch(label="excluded from the requirement", **_EXCLUDED))
    else:
        two = any(MOST_MEDIAN in panel.bands for panel in panels)
        lines = [
            Line2D(
                [], [], color=INK, linewidth=1.6, label="least and most median" if two else "median"
            )
        ]
    _legend(figure, rows, [low for low, *_ in BANDS], lines)
    return figure


@styled
def plot_errors(panels: Sequence[tuple[str, str, str, EnvelopePanel]]) -> Figure:
    """Plot one flight per panel with its limits; panels have a title, a y label and a colour."""
    columns, width = (2, 5.0) if len(panels) <= 4 else (3, WIDTH)
    figure, grid = new_panels(
        len(panels), min(columns, len(panels)), 0.8, between=(0.85, 0.4), left=0.85, width=width
    )
    for axes, (title, label, color, panel) in zip(grid.flat, panels, strict=False):
        axes.plot(panel.x, panel.flights[0][1], color=color, linewidth=1.1)
        for x, y in panel.limits:
            axes.plot(x, y, **LIMIT)
        axes.set_xlim(float(panel.x[0]), float(panel.x[-1]) or 1.0)
        _set_y_limits(axes, EnvelopeRow(label, [panel]))
        title_panel(axes, title, color=color)
        axes.set_ylabel(fill(label, _SHORT), va="center")
    for axes in grid[-1]:
        axes.set_xlabel("time (s)")
    return figure


@styled
def plot_sheet(rows: Sequence[EnvelopeRow], labels: Sequence[str]) -> Figure:
    """Plot one panel per channel with each controller's full range, 5 to 95 % band and median."""
    figure, grid = new_panels(len(rows), 3, 1.3, between=(0.42, 0.62))
    for axes, row in zip(grid.flat, rows, strict=False):
        _overlay(axes, row)
        title_panel(axes, row.label)
        _set_y_limits(axes, row)
        if row.inset:
            _draw_inset(axes, row)
        axes.set_xlabel(row.across)
    drawn = {name for row in rows for panel in row.panels for name in panel.bands}
    # The curve of a single flight is not a median.
    kind = "" if drawn <= {"q50"} else ", median"
    lines = [
        Line2D([], [], label=f"{name}{kind}".replace("$", r"\$"), **line_look(k, len(labels)))
        for k, name in enumerate(labels)
    ]
    if any(panel.limits for row in rows for panel in row.panels):
        lines.append(Line2D([], [], label="limit", **LIMIT))
    _legend(figure, rows, ("min", "q5"), lines)
    return figure


def _overlay(axes: Axes, row: EnvelopeRow) -> None:
    """Draw all controllers: the first with filled bands, the others with outlined bands."""
    for k, panel in enumerate(row.panels):
        look = line_look(k, len(row.panels))
        color, order = look["color"], look["zorder"]
        for low, high, opacity, _ in [band for band in BANDS[::2] if band[0] in panel.bands]:
            edges = panel.bands[low], panel.bands[high]
            if k == 0:
                axes.fill_between(panel.x, *edges, color=color, alpha=opacity, linewidth=0)
            else:
                outline = look | {"linewidth": 0.6, "alpha": 2.0 * opacity, "zorder": order - 1.0}
                axes.plot(panel.x, np.transpose(edges), **outline)
        for median in [name for name in MEDIANS if name in panel.bands]:
            axes.plot(panel.x, panel.bands[median], **look)
        for edge in [name for name in SIMULTANEOUS if name in panel.bands]:
            curve = panel.x, panel.bands[edge]
            axes.plot(*curve, color=color, zorder=order, **_SIMULTANEOUS_LINE)
    for limit in row.panels[0].limits:
        axes.plot(*limit, **LIMIT)
    if row.panels[0].reference is not None:
        # The reference is thinner than the medians.
        axes.plot(*row.panels[0].reference, **REFERENCE, zorder=4.0)


def _draw_inset(axes: Axes, row: EnvelopeRow) -> None:
    """Add an inset above the curves that enlarges the time around the largest change."""
    peaks = []
    for panel in row.panels:
        middle = np.nanmedian(panel.bands["q50"])
        most = np.fmax.reduce([np.abs(band - middle) for band in panel.bands.values()])
        peaks.append((float(np.nanmax(most)), float(panel.x[np.nanargmax(most)])))
    start, end = row.panels[0].x[[0, -1]]
    if end - start < 4.0 * _SHOWN:
        return
    center = float(np.clip(max(peaks)[1], start + _SHOWN, end - _SHOWN))
    low, high = axes.get_ylim()
    axes.set_yticks([tick for tick in MaxNLocator(4).tick_values(low, high) if low <= tick <= high])
    axes.set_ylim(low, high + 0.75 * (high - low))
    # Grid lines of the panel that cross the inset would be mistaken for grid lines of the inset.
    axes.grid(visible=False, axis="x")
    axes.axvspan(center - _SHOWN, center + _SHOWN, 0.0, _INSET[1], **_ENLARGED)
    inset = axes.inset_axes(_INSET)
    inset.spines[:].set(visible=True, linewidth=0.4)
    _overlay(inset, row)
    inset.set_xlim(center - _SHOWN, center + _SHOWN)
    _set_y_limits(inset, row)
    inset.locator_params(nbins=2)
    inset.tick_params(length=2, pad=1)


def _set_y_limits(axes: Axes, row: EnvelopeRow) -> None:
    """Set the y limits to the range of the values within the x limits, plus a margin."""
    low, high = np.inf, -np.inf
    left, right = axes.get_xlim()
    for panel in row.panels:
        curves = [(panel.x, band) for band in panel.bands.values()]
        curves += [*panel.flights, *panel.limits]
        curves += [panel.reference] if panel.reference is not None else []
        for x, y in curves:
            inside = y[(x >= left) & (x <= right) & np.isfinite(y)]
            if inside.size:
                low, high = min(low, float(inside.min())), max(high, float(inside.max()))
    if not np.isfinite(high - low):
        return
    margin = 0.06 * (high - low) or max(1e-3 * abs(high), 1e-6)
    axes.set_ylim(low - margin, high + margin)


def off_reference(x: Floats, y: Floats, time: Floats, reference: Floats | None) -> Floats:
    """Subtract the reference [time], if any, from a channel ``y`` at the times ``x`` in s."""
    return y if reference is None else y - np.interp(x, time, reference)


def bands_off(
    x: Floats, bands: Mapping[str, Floats], time: Floats, reference: Floats | None
) -> dict[str, Floats]:
    """Subtract the reference [time], if any, from a channel's bands at the times ``x`` in s.

    The minimum and maximum cover all control ticks between two samples. Both are omitted if the
    reference varies, because a change of the reference between samples would appear as an error.
    """
    moves = reference is not None and float(np.ptp(reference)) > 0.0
    drawn_bands = {
        name: band for name, band in bands.items() if not (moves and name in ("min", "max"))
    }
    return {name: off_reference(x, band, time, reference) for name, band in drawn_bands.items()}
