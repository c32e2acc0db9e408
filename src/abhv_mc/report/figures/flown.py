"""Channels of single flights: every controller in the same axes, beside reference and command."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.topics.envelopes.figures import CHANNEL_FIGURES, GROUND_TRACK, Curve
from abhv_mc.topics.figure_style import INK, controller_colors, legend_below, new_figure, pad_if_flat, styled
from abhv_mc.topics.labels import controller_label

Columns = Mapping[str, Floats]  # time and channels of one flight, or of the reference


@dataclass(frozen=True)
class _Row:
    """One pair of axes."""

    curve: Curve
    x: str = "time"
    x_label: str = "time (s)"
    x_scale: float = 1.0


def plot_flown(flights: Mapping[str, Columns], reference: Columns) -> Iterator[tuple[str, Figure]]:
    """Name and figure of each channel with one flight of each controller."""
    track = _Row(Curve("north_m", "north (km)", "north_reference_m", scale=1e-3), "east", "east (km)", 1e-3)
    yield GROUND_TRACK.name, _plot([track], flights, reference)
    for figure in CHANNEL_FIGURES:
        yield figure.name, _plot([_Row(curve) for curve in figure.curves], flights, reference)


def _x(row: _Row, columns: Columns, ending: str) -> Floats:
    return columns["time"] if row.x == "time" else columns[row.x + ending] * row.x_scale


@styled
def _plot(rows: list[_Row], flights: Mapping[str, Columns], reference: Columns) -> Figure:
    figure = new_figure(0.55 + 1.9 * len(rows), 5.0)
    grid = figure.subplots(len(rows), 1, squeeze=False)[:, 0]
    colors = controller_colors(list(flights))
    for axes, row in zip(grid, rows, strict=True):
        curve = row.curve
        if curve.reference:
            x, y = _x(row, reference, "_reference_m"), reference[curve.reference] * curve.scale
            axes.plot(x, y, color=INK, linewidth=0.7, zorder=3, label="reference")
        for name, flight in flights.items():
            x = _x(row, flight, "_m")
            label = controller_label(name).replace("$", r"\$")  # a file's name may hold what is else drawn as a formula
            axes.plot(x, flight[curve.channel] * curve.scale, color=colors[name], label=label)
            if curve.command:
                command = flight[curve.command] * curve.scale
                axes.plot(x, command, color=colors[name], linewidth=0.8, linestyle=":", label=f"{label} command")
        axes.set_xlabel(row.x_label)
        axes.set_ylabel(curve.label)
        if curve.x_range:
            axes.set_xlim(*curve.x_range)
        pad_if_flat(axes)
    legend_below(figure, grid[0])
    return figure
