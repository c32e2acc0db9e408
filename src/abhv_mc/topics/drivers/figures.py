"""What moves each error, as a tornado chart a controller."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from abhv_mc.topics.drivers import Drivers, Ends, MetricDrivers
from abhv_mc.topics.figure_style import INK, WIDTH, controller_colors, new_figure, styled
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import FigureText
from abhv_mc.topics.words import spoken_name

_BARS = 3  # of an error: the largest of any controller
_ROW = 0.155  # in, of a bar


@dataclass(frozen=True)
class TornadoBar:
    """One row: a parameter's effect under each controller; None if chance explains it."""

    label: str
    coefficients: Sequence[Ends | None]  # [controller]
    shares: Sequence[tuple[float, float] | None]  # [controller] of the variance, alone and in all


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
            "Solid: standardized rank regression coefficients with 95 % intervals, to the right where the metric grows "
            'with the parameter ("high or low": with its distance from the median). Open, if the effect is not '
            "monotonic: the parameter's share of the variance of ranks, alone (solid part) and in all.",
        )
        yield text, plot_tornado(charts, {name: names.label(name) for name in drivers.controllers})


def _bars(entries: Sequence[MetricDrivers | None]) -> list[TornadoBar]:
    """The parameters that move an error most under any controller, largest first."""
    coefficients: list[dict[str, Ends]] = []
    shares: list[dict[str, tuple[float, float]]] = []
    for entry in entries:
        coefficients.append(
            {
                spoken_name(d.parameter) + (", high or low" if d.either_way else ""): d.srrc
                for d in (entry.parameters if entry else ())
                if d.driver
            }
        )
        shares.append(
            {
                spoken_name(each.parameter): (each.first, each.total)
                for each in (entry.otherwise if entry else ())
            }
        )
    largest: dict[str, float] = {}
    sizes = [
        (name, abs(value)) for effects in coefficients for name, (value, *_) in effects.items()
    ]
    sizes += [(name, total) for effects in shares for name, (_, total) in effects.items()]
    for name, size in sizes:
        largest[name] = max(largest.get(name, 0.0), size)
    ranked = sorted(largest, key=lambda name: -largest[name])[:_BARS]
    return [
        TornadoBar(name, [c.get(name) for c in coefficients], [s.get(name) for s in shares])
        for name in ranked
    ]


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
            if (coefficient := bar.coefficients[c]) is not None:
                value, low, high = coefficient
                axes.barh(at, value, 0.7, color=color)
                axes.plot([low, high], [at, at], color=INK, linewidth=0.9)
            elif (share := bar.shares[c]) is not None:
                axes.barh(at, share[1], 0.7, fill=False, edgecolor=color, linewidth=0.8)
                axes.barh(at, max(share[0], 0.0), 0.7, color=color)
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
