"""Figures of docs/explanation/paper.md: nominal flights of one member over the paper's axes."""

from collections.abc import Mapping

import numpy as np
from experiment import Floats
from matplotlib.figure import Figure
from paper_vehicle_flights import AXES, LAWS, PERIOD, Axis

from abhv_mc.topics.figure_style import GRID, controller_colors, new_figure, styled

THEIR_START = 180.0  # s, the paper's time at the beginning of the S
# Law -> channel -> [flight, time], the nominal flight first.
Flown = Mapping[str, Mapping[str, Floats]]


def turned(axis: Axis, mirrored: bool, values: Floats) -> Floats:
    """Return a channel with the signs of the page."""
    if axis.figure == 4:
        return 180.0 - values
    return -values if mirrored else values


@styled
def plot_axis(channel: str, flown: Flown, mirrored: Mapping[int, bool]) -> Figure:
    """Plot a channel over the paper's time: nominal flights, commands and dispersed flights."""
    axes = [axis for axis in AXES if axis.channels[0] == channel and axis.window[1] > 8.0]
    first = axes[0]
    figure = new_figure(2.0, 3.5)
    panel = figure.subplots()
    colors = controller_colors(LAWS)
    lowest, highest = min(axis.lowest[0] for axis in axes), max(axis.highest[1] for axis in axes)
    panel.axhspan(lowest, highest, color=GRID, alpha=0.5, linewidth=0.0, label="paper's range")
    for law in LAWS:
        values = turned(first, mirrored[first.figure], flown[law][channel])
        times = THEIR_START + PERIOD * np.arange(values.shape[1])
        panel.fill_between(
            times, values.min(0), values.max(0), color=colors[law], alpha=0.2, linewidth=0.0
        )
        panel.plot(times, values[0], color=colors[law], label=law.upper())
        for command in first.channels[1:]:
            panel.plot(times, flown[law][command][0], ":", color=colors[law], linewidth=0.8)
    panel.set_xlabel("the paper's time (s)")
    panel.set_ylabel(first.label.partition(",")[0])
    figure.legend(loc="outside lower center", ncols=3, fontsize=6.0)
    return figure


@styled
def plot_track(flown: Flown) -> Figure:
    """Plot latitude over longitude, as Figure 2."""
    figure = new_figure(2.0, 3.5)
    axes = figure.subplots()
    colors = controller_colors(LAWS)
    for law in LAWS:
        axes.plot(
            flown[law]["longitude_deg"][0],
            flown[law]["latitude_deg"][0],
            color=colors[law],
            label=law.upper(),
        )
    axes.set_xlabel("longitude (deg)")
    axes.set_ylabel("latitude (deg)")
    figure.legend(loc="outside lower center", ncols=2, fontsize=6.0)
    return figure
