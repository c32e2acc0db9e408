"""Bands over all flights, one column a controller, with the nominal flight, the reference and the command."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from abhv_mc.array_types import Floats
from abhv_mc.folder.envelopes import MOST_MEDIAN
from abhv_mc.topics.figure_style import INK, new_panels, put_legend, styled

# Widest first; (lower, upper, opacity, words)
BANDS = (
    ("min", "max", 0.18, "all flights"),
    ("q0.135", "q99.865", 0.30, "0.135–99.865 %"),
    ("q5", "q95", 0.45, "5–95 %"),
)
MEDIANS = ("q50", MOST_MEDIAN)
REFERENCE = {"color": INK, "linewidth": 0.6, "linestyle": "-"}
NOMINAL = {"color": INK, "linewidth": 1.1, "linestyle": (0, (4, 2))}
COMMAND = {"color": INK, "linewidth": 1.3, "linestyle": (0, (1, 1.2))}


@dataclass(frozen=True)
class EnvelopePanel:
    """One channel of one controller; every curve is (x, y)."""

    x: Floats  # [time] s, or what the bands are drawn against
    bands: Mapping[str, Floats]  # min, q0.135, q5, q50, q95, q99.865, max -> [time]; with unknowns q50_most
    nominal: tuple[Floats, Floats] | None = None
    reference: tuple[Floats, Floats] | None = None
    command: tuple[Floats, Floats] | None = None
    flights: Sequence[tuple[Floats, Floats]] = ()  # single flights, thin


@dataclass(frozen=True)
class EnvelopeRow:
    """Panels that share their axes, one a controller."""

    label: str  # of the y axis, with its unit
    panels: Sequence[EnvelopePanel]
    x_label: str = "time (s)"
    x_range: tuple[float, float] | None = None
    note: str = field(default="")  # in the corner of each panel


def _draw(axes: Axes, panel: EnvelopePanel, color: str) -> None:
    for low, high, opacity, _ in [band for band in BANDS if band[0] in panel.bands]:
        axes.fill_between(panel.x, panel.bands[low], panel.bands[high], color=color, alpha=opacity, linewidth=0)
    for x, y in panel.flights:
        axes.plot(x, y, color=INK, linewidth=0.5, zorder=3)
    for median in [name for name in MEDIANS if name in panel.bands]:
        axes.plot(panel.x, panel.bands[median], color=color, linewidth=1.6)
    for curve, look in ((panel.reference, REFERENCE), (panel.nominal, NOMINAL), (panel.command, COMMAND)):
        if curve is not None:
            axes.plot(*curve, **look)  # type: ignore[arg-type]


def _legend(figure: Figure, rows: Sequence[EnvelopeRow]) -> None:
    panels = [panel for row in rows for panel in row.panels]
    handles: list[Patch | Line2D] = [
        Patch(facecolor="#555555", alpha=opacity + 0.1 * i, linewidth=0, label=words)
        for i, (_, _, opacity, words) in enumerate(BANDS)
    ]
    medians = "least and most median" if any(MOST_MEDIAN in panel.bands for panel in panels) else "median"
    handles.append(Line2D([], [], color="#555555", linewidth=1.2, label=medians))
    for name, look in (("reference", REFERENCE), ("nominal", NOMINAL), ("command", COMMAND)):
        if any(getattr(panel, name) is not None for panel in panels):
            words = {"nominal": "nominal flight", "command": "command (median)"}.get(name, name)
            handles.append(Line2D([], [], label=words, **look))  # type: ignore[arg-type]
    if any(panel.flights for panel in panels):
        handles.append(Line2D([], [], color=INK, linewidth=0.5, label="worst flights"))
    put_legend(figure, handles, [str(handle.get_label()) for handle in handles])


@styled
def plot_envelopes(rows: Sequence[EnvelopeRow], titles: Sequence[str], colors: Sequence[str]) -> Figure:
    """Rows of panels, columns of controllers; y is shared along a row so that controllers compare at sight."""
    count = len(rows) * len(titles)
    figure, grid = new_panels(count, len(titles), 1.25, between=(0.2, 0.48), sharex="row", sharey="row")
    for r, row in enumerate(rows):
        for c, panel in enumerate(row.panels):
            axes = grid[r, c]
            _draw(axes, panel, colors[c])
            if r == 0:
                axes.set_title(titles[c], color=colors[c])
            if c == 0:
                axes.set_ylabel(row.label)
            if r == len(rows) - 1 or rows[r + 1].x_range != row.x_range:
                axes.set_xlabel(row.x_label)
            if row.note:
                axes.text(0.98, 0.96, row.note, transform=axes.transAxes, ha="right", va="top", fontsize=7, color=INK)
        first = grid[r, 0]
        flown = np.concatenate([panel.x[np.isfinite(panel.x)] for panel in row.panels])
        if row.x_range or flown.size:  # every flight may have ended early
            first.set_xlim(*(row.x_range or (float(flown.min()), float(flown.max()) or 1.0)))
        _set_y_limits(first, row)
    _legend(figure, rows)
    return figure


def _set_y_limits(axes: Axes, row: EnvelopeRow) -> None:
    """Limits from what lies inside the x range, with a margin; never a range of nothing."""
    low, high = np.inf, -np.inf
    left, right = axes.get_xlim()
    for panel in row.panels:
        curves = [*((panel.x, band) for band in panel.bands.values()), *panel.flights]
        curves += [curve for curve in (panel.nominal, panel.reference, panel.command) if curve is not None]
        for x, y in curves:
            inside = y[(x >= left) & (x <= right) & np.isfinite(y)]
            if inside.size:
                low, high = min(low, float(inside.min())), max(high, float(inside.max()))
    if not np.isfinite(high - low):
        return
    margin = 0.06 * (high - low) or max(1e-3 * abs(high), 1e-6)
    axes.set_ylim(low - margin, high + margin)


def off_reference(x: Floats, y: Floats, time: Floats, reference: Floats | None) -> Floats:
    """A channel [x] s less its reference [time]; as it is without one."""
    return y if reference is None else y - np.interp(x, time, reference)


def shown_bands(bands: Mapping[str, Floats], reference: Floats | None) -> dict[str, Floats]:
    """The bands of a channel that mean something less its reference.

    Minimum and maximum are those of all control ticks between two samples: less a reference that moves meanwhile, they
    would show its way and not the flights' error.
    """
    moves = reference is not None and float(np.ptp(reference)) > 0.0
    return {name: band for name, band in bands.items() if not (moves and name in ("min", "max"))}
