"""The figures of docs/explanation/paper.md: both laws' nominal flights of one member over the paper's axes."""

from collections.abc import Mapping

import numpy as np
from experiment import Floats
from matplotlib.figure import Figure
from paper_vehicle_flights import AXES, LAWS, PERIOD, Axis

from abhv_mc.topics.figure_style import GRID, controller_colors, new_figure, styled

THEIR_START = 180.0  # s, the paper's time at the beginning of the S
Flown = Mapping[
    str, Mapping[str, Floats]
]  # by law and channel, [flight, time], the nominal flight first


def turned(axis: Axis, mirrored: bool, values: Floats) -> Floats:
    """A channel in the signs that the page shows."""
    if axis.figure == 4:
        return 180.0 - values
    return -values if mirrored else values


@styled
def plot_axis(channel: str, flown: Flown, mirrored: Mapping[int, bool]) -> Figure:
    """A channel over the paper's time: the laws' nominal flights, their commands, and all dispersed flights."""
    axes = [axis for axis in AXES if axis.channels[0] == channel and axis.window[1] > 8.0]
    first = axes[0]
    figure = new_figure(2.0, 3.5)
    drawn = figure.subplots()
    colors = controller_colors(LAWS)
    lowest, highest = min(axis.lowest[0] for axis in axes), max(axis.highest[1] for axis in axes)
    drawn.axhspan(lowest, highest, color=GRID, alpha=0.5, linewidth=0.0, label="paper's range")
    for law in LAWS:
        values = turned(first, mirrored[first.figure], flown[law][channel])
        times = THEIR_START + PERIOD * np.arange(values.shape[1])
        drawn.fill_between(
            times, values.min(0), values.max(0), color=colors[law], alpha=0.2, linewidth=0.0
        )
        drawn.plot(times, values[0], color=colors[law], label=law.upper())
        for command in first.channels[1:]:
            drawn.plot(times, flown[law][command][0], ":", color=colors[law], linewidth=0.8)
    drawn.set_xlabel("the paper's time (s)")
    drawn.set_ylabel(first.words.partition(",")[0])
    figure.legend(loc="outside lower center", ncols=3, fontsize=6.0)
    return figure


@styled
def plot_track(flown: Flown) -> Figure:
    """Latitude over longitude, as Figure 2."""
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
