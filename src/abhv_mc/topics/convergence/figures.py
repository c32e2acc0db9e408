"""Figure of the convergence of estimates with the number of flights."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator, ScalarFormatter

from abhv_mc.array_types import Floats
from abhv_mc.topics.convergence import Convergence, settled_level
from abhv_mc.topics.figure_style import (
    LOG_AXIS,
    legend_below,
    line_look,
    log_if_wide,
    mark_look,
    new_panels,
    styled,
    title_panel,
)
from abhv_mc.topics.topic import Drawn, FigureText, Names


def draw(convergence: Convergence, names: Names) -> Iterator[Drawn]:
    """Yield the convergence figure, which has one panel per leading metric."""
    if not convergence.is_drawn:
        return
    flights = {
        name: np.array(trace.flights, float) for name, trace in convergence.controllers.items()
    }
    panels: list[tuple[str, dict[str, Floats]]] = []
    for metric in names.asked:
        tables = {name: trace.metrics[metric] for name, trace in convergence.controllers.items()}
        level, quantile_name = settled_level(convergence, metric)
        series = {
            name: np.array([table[level].value, table[level].low, table[level].high])
            for name, table in tables.items()
        }
        if any(np.isfinite(table[0]).any() for table in series.values()):
            quantile = quantile_name.replace(" ", "\N{NO-BREAK SPACE}")
            label = f"{names.metrics[metric].label_with_unit}, {quantile}"
            finite = {name: np.where(np.isfinite(x), x, np.nan) for name, x in series.items()}
            panels.append((label, finite))
    if panels:
        text = FigureText(
            "convergence",
            "Convergence",
            "The 95 % quantile of each error (or the median, if more than 5 % of the flights "
            "terminated early) against the number of flights. The exact 95 % interval is shaded "
            "if the flights bound it on both sides.",
        )
        yield text, plot_convergence(flights, panels, names.controllers)


@styled
def plot_convergence(
    flights: Mapping[str, Floats],
    panels: Sequence[tuple[str, Mapping[str, Floats]]],
    labels: Mapping[str, str],
) -> Figure:
    """Plot estimates with their intervals [value, low, high; check]; open bounds are NaN."""
    figure, grid = new_panels(len(panels), min(3, len(panels)), 1.2, between=(0.5, 0.58))
    for axes, (title, series) in zip(grid.flat, panels, strict=False):
        for i, (name, (value, low, high)) in enumerate(series.items()):
            bounded = np.isfinite(low) & np.isfinite(high)
            look = line_look(i, len(series)) | mark_look(i, len(series), 3.0)
            area = {"color": look["color"], "alpha": 0.2, "zorder": look["zorder"] - 2.0}
            axes.fill_between(flights[name], low, high, where=bounded, linewidth=0, **area)
            face = "none" if i else look["color"]
            look |= {"linewidth": 1.0, "markerfacecolor": face, "markevery": (i, 2)}
            axes.plot(flights[name], value, label=labels[name], **look)
        axes.margins(y=0.1)
        is_log = log_if_wide(axes, "y", [value for value, *_ in series.values()])
        axes.set_xscale("log")
        _ticks(axes, np.concatenate(list(flights.values())))
        title_panel(axes, ", ".join([title, *[LOG_AXIS] * is_log]))
        axes.set_xlabel(f"flights ({LOG_AXIS})")
    legend_below(figure, grid.flat[0])
    return figure


def _ticks(axes: Axes, flights: Floats) -> None:
    """Place ticks at a few round numbers of flights within the plotted range."""
    candidates = [step * 10**power for power in range(7) for step in (1, 2, 5)]
    inside = [c for c in candidates if flights.min() <= c <= flights.max()]
    inside = [c for c in inside if str(c)[0] == "1"] if len(inside) > 6 else inside
    axes.xaxis.set_major_locator(FixedLocator(inside))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(ScalarFormatter())
    axes.xaxis.set_minor_formatter(NullFormatter())
