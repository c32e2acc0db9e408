"""What moves each error, as a tornado chart a controller."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from abhv_mc.topics.drivers.model import Drivers, MetricDrivers
from abhv_mc.topics.figure_style import INK, WIDTH, controller_colors, new_figure, styled
from abhv_mc.topics.names import Names
from abhv_mc.topics.parameter_words import spoken_name
from abhv_mc.topics.section import FigureText

_BARS = 3  # of an error: the largest of any controller
_ROW = 0.155  # in, of a bar


@dataclass(frozen=True)
class TornadoBar:
    """One row: a parameter's effect under each controller (value, low, high; the share alone of one 'in all')."""

    label: str
    effects: Sequence[tuple[float, float, float] | None]  # [controller]; None where chance explains it
    shares: Sequence[bool]  # [controller] whether it is a share of the variance of ranks


@dataclass(frozen=True)
class Tornado:
    """The bars of one error."""

    label: str
    bars: Sequence[TornadoBar]


def draw(drivers: Drivers, names: Names) -> Iterator[tuple[FigureText, Figure]]:
    """The drivers of the metrics that stand first."""
    charts = []
    for metric in names.asked:
        entries = [part.metrics.get(metric) for part in drivers.controllers.values()]
        if bars := _bars(entries):
            charts.append(Tornado(names.metrics[metric].label, bars))
    if charts:
        text = FigureText(
            "drivers",
            "What moves the errors",
            "Solid: standardized rank regression coefficients with 95 % intervals, to the right where the error grows "
            'with the parameter ("high or low": with its distance from the median). Open, where the relation is not '
            "monotonic: the parameter's share of the variance of ranks, alone (solid part) and in all.",
        )
        labels = [names.label(name) for name in drivers.controllers]
        yield text, plot_tornado(charts, labels, list(controller_colors(tuple(drivers.controllers)).values()))


def _bars(entries: Sequence[MetricDrivers | None]) -> list[TornadoBar]:
    """The parameters that move an error most under any controller, largest first."""
    found: list[dict[str, tuple[float, float, float]]] = []
    open_: list[bool] = []
    for entry in entries:
        effects = {}
        for each in entry.parameters if entry else ():
            if each.driver:
                effects[spoken_name(each.parameter) + (", high or low" if each.either_way else "")] = each.srrc
        shared = not effects and entry is not None
        if shared and entry is not None:
            effects = {spoken_name(each.parameter): (each.total, each.first, each.total) for each in entry.otherwise}
        found.append(effects)
        open_.append(shared)
    largest: dict[str, float] = {}
    for effects in found:
        for name, (value, *_) in effects.items():
            largest[name] = max(largest.get(name, 0.0), abs(value))
    ranked = sorted(largest, key=lambda name: -largest[name])[:_BARS]
    return [TornadoBar(name, [effects.get(name) for effects in found], open_) for name in ranked]


@styled
def plot_tornado(charts: Sequence[Tornado], labels: Sequence[str], colors: Sequence[str]) -> Figure:
    """A column a controller, a group of bars an error; one scale of -1 to 1 throughout."""
    places, ticks, heads = [], [], []
    y = 0.0
    for chart in charts:
        heads.append((y, chart.label))
        for bar in chart.bars:
            y += 1.0
            places.append((y, bar))
            ticks.append(bar.label)
        y += 1.4
    figure = new_figure(0.75 + _ROW * y, WIDTH)
    grid = figure.subplots(1, len(labels), squeeze=False, sharex=True, sharey=True)[0]
    for c, axes in enumerate(grid):
        axes.set_title(labels[c], color=colors[c])
        axes.grid(visible=False, axis="y")
        axes.axvline(0.0, color=INK, linewidth=0.6)
        for at, bar in places:
            effect = bar.effects[c]
            if effect is None:
                continue
            value, low, high = effect
            if bar.shares[c]:
                axes.barh(at, value, 0.7, fill=False, edgecolor=colors[c], linewidth=0.8)
                axes.barh(at, max(low, 0.0), 0.7, color=colors[c])
            else:
                axes.barh(at, value, 0.7, color=colors[c])
                axes.plot([low, high], [at, at], color=INK, linewidth=0.9)
        axes.set_xlim(-1.08, 1.08)
        axes.set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0], ["−1", "", "0", "", "1"])
        axes.spines["left"].set_visible(False)
        axes.tick_params(axis="y", length=0)
    grid[0].set_ylim(y - 0.9, -0.6)
    grid[0].set_yticks([at for at, _ in heads] + [at for at, _ in places], [text for _, text in heads] + ticks)
    for tick in grid[0].get_yticklabels()[: len(heads)]:
        tick.set_fontweight("bold")
    return figure
