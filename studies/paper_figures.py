"""The figures of docs/explanation/paper.md."""

from matplotlib.figure import Figure
from paper_points import Point

from abhv_mc.folder.results import Results
from abhv_mc.topics.figure_style import GRID, controller_colors, new_figure, styled
from abhv_mc.topics.labels import controller_label

THEIR_START = 180.0  # s, the paper's time at the beginning of the S
COMMANDS = {
    "angle_of_attack_deg": "angle_of_attack_command_deg",
    "bank_deg": "bank_command_deg",
}  # the paper shows them
ZOOMED = 3.0  # curves that leave the paper's range by this many widths are shown once more, near it


@styled
def plot_point(results: Results, point: Point) -> Figure:
    """The nominal flights over the paper's time, TLC's dispersed flights and the paper's range behind them.

    Commands are dotted. Curves that leave the range far are shown a second time, near it.
    """
    curves = {name: point.ours(flown[point.channel]) for name, flown in results.nominal.items()}
    furthest = max(max(values.max() - point.high, point.low - values.min()) for values in curves.values())
    twice = furthest > ZOOMED * (point.high - point.low)
    figure = new_figure(2.0, 6.4 if twice else 3.5)
    panels = figure.subplots(1, 2 if twice else 1, squeeze=False)[0]
    colors = controller_colors(results.controllers)
    envelope = results.envelopes["tlc", point.channel]
    low, high = (point.ours(envelope.bands[end]) for end in ("min", "max"))
    for axes in panels:
        axes.axhspan(point.low, point.high, color=GRID, alpha=0.5, linewidth=0.0, label="paper's range")
        axes.fill_between(envelope.time + THEIR_START, low, high, color=colors["tlc"], alpha=0.25, linewidth=0.0)
        for name, flown in results.nominal.items():
            times = flown["time"] + THEIR_START
            axes.plot(times, curves[name], color=colors[name], label=controller_label(name))
            if point.channel in COMMANDS:
                command = point.ours(flown[COMMANDS[point.channel]])
                axes.plot(times, command, ":", color=colors[name], linewidth=0.8)
        axes.set_xlabel("the paper's time (s)")
    panels[0].set_ylabel(f"{point.words} ({point.unit})" if point.unit else point.words.split(",")[0])
    if twice:
        width = point.high - point.low
        panels[1].set_ylim(point.low - 0.5 * width, point.high + 0.5 * width)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=6.0)
    return figure


@styled
def plot_track(results: Results) -> Figure:
    """Latitude over longitude, as Figure 2."""
    figure = new_figure(2.0, 3.5)
    axes = figure.subplots()
    colors = controller_colors(results.controllers)
    for name, flown in results.nominal.items():
        x, y = flown["longitude_deg"], flown["latitude_deg"]
        axes.plot(x, y, color=colors[name], label=controller_label(name))
    axes.set_xlabel("longitude (deg)")
    axes.set_ylabel("latitude (deg)")
    figure.legend(loc="outside lower center", ncols=3, fontsize=6.0)
    return figure
