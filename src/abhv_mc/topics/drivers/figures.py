"""What moves each error, as a tornado chart a controller."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from abhv_mc.topics.drivers import Drivers, MetricDrivers
from abhv_mc.topics.figure_style import INK, WIDTH, controller_colors, new_figure, styled
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import FigureText
from abhv_mc.topics.words import spoken_name

_BARS = 3  # of an error: the largest of any controller
_ROW = 0.155  # in, of a bar


@dataclass(frozen=True)
class TornadoBar:
    """One row: a parameter's effect under each controller (value, low, high; the share alone of one 'in all')."""

    label: str
    effects: Sequence[
        tuple[float, float, float] | None
    ]  # [controller]; None where chance explains it
    shares: Sequence[bool]  # [controller] whether it is a share of the variance of ranks


def draw(drivers: Drivers, names: Names) -> Iterator[tuple[FigureText, Figure]]:
    """The drivers of the metrics that stand first."""
    charts = []
    for metric in names.asked:
        entries = [part.metrics.get(metric) for part in drivers.controllers.values()]
        if bars := _bars(entries):
            charts.append((names.metrics[metric].label, bars))
    if charts:
        text = FigureText(
            "drivers",
            "What moves the errors",
            "Solid: standardized rank regression coefficients with 95 % intervals, to the right where the error grows "
            'with the parameter ("high or low": with its distance from the median). Open, where the relation is not '
            "monotonic: the parameter's share of the variance of ranks, alone (solid part) and in all.",
        )
        yield text, plot_tornado(charts, {name: names.label(name) for name in drivers.controllers})


def _bars(entries: Sequence[MetricDrivers | None]) -> list[TornadoBar]:
    """The parameters that move an error most under any controller, largest first."""
    found: list[dict[str, tuple[float, float, float]]] = []
    shares: list[bool] = []
    for entry in entries:
        drivers = [each for each in entry.parameters if each.driver] if entry else []
        shares.append(entry is not None and not drivers)
        found.append(
            {
                spoken_name(d.parameter) + (", high or low" if d.either_way else ""): d.srrc
                for d in drivers
            }
        )
        if entry and not drivers:
            found[-1] = {
                spoken_name(each.parameter): (each.total, each.first, each.total)
                for each in entry.otherwise
            }
    largest: dict[str, float] = {}
    for effects in found:
        for name, (value, *_) in effects.items():
            largest[name] = max(largest.get(name, 0.0), abs(value))
    ranked = sorted(largest, key=lambda name: -largest[name])[:_BARS]
    return [TornadoBar(name, [effects.get(name) for effects in found], shares) for name in ranked]


@styled
def plot_tornado(
    charts: Sequence[tuple[str, Sequence[TornadoBar]]], labels: Mapping[str, str]
) -> Figure:
    """A column a controller, a group of bars an error; one scale of -1 to 1 throughout."""
    heads, places = [], []
    y = 0.0
    for label, bars in charts:
        heads.append((y, label))
        places += [(y + 1.0 + k, bar) for k, bar in enumerate(bars)]
        y += len(bars) + 1.4
    figure = new_figure(0.75 + _ROW * y, WIDTH)
    grid = figure.subplots(1, len(labels), squeeze=False, sharex=True, sharey=True)[0]
    colors = controller_colors(tuple(labels))
    for c, (axes, (name, label)) in enumerate(zip(grid, labels.items(), strict=True)):
        color = colors[name]
        axes.set_title(label, color=color)
        axes.grid(visible=False, axis="y")
        axes.axvline(0.0, color=INK, linewidth=0.6)
        for at, bar in places:
            effect = bar.effects[c]
            if effect is None:
                continue
            value, low, high = effect
            if bar.shares[c]:
                axes.barh(at, value, 0.7, fill=False, edgecolor=color, linewidth=0.8)
                axes.barh(at, max(low, 0.0), 0.7, color=color)
            else:
                axes.barh(at, value, 0.7, color=color)
                axes.plot([low, high], [at, at], color=INK, linewidth=0.9)
        axes.set_xlim(-1.08, 1.08)
        axes.set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0], ["−1", "", "0", "", "1"])
        axes.spines["left"].set_visible(False)
        axes.tick_params(axis="y", length=0)
    grid[0].set_ylim(y - 0.9, -0.6)
    named = [*heads, *((at, bar.label) for at, bar in places)]
    grid[0].set_yticks([at for at, _ in named], [text for _, text in named])
    for tick in grid[0].get_yticklabels()[: len(heads)]:
        tick.set_fontweight("bold")
    return figure
