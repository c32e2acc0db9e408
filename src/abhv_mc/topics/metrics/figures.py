"""Figures of the distributions of metrics."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.topics.figure_style import (
    controller_colors,
    distribution_steps,
    label_shares,
    legend_below,
    line_look,
    make_value_axis,
    new_panels,
    styled,
)
from abhv_mc.topics.metrics import Metrics
from abhv_mc.topics.topic import Drawn, FigureText, Names


@dataclass(frozen=True)
class Spread:
    """Values of one metric in the flights of every controller."""

    label: str
    # controller -> value per flight; infinite if the flight terminated early
    values: Mapping[str, Floats]
    limits: Sequence[float] = ()  # limits of requirements
    unit: str = ""


@styled
def plot_distributions(
    spreads: Sequence[Spread],
    labels: Mapping[str, str],
    colors: Mapping[str, str],
    dashed: Collection[str] = (),
) -> Figure:
    """Plot cumulative shares of flights, with a panel per metric and a line per controller.

    If there are ``dashed`` lines, all other lines are solid.
    """
    looks = {
        name: {**line_look(i, len(labels)), "color": colors[name], "label": label}
        | ({"linestyle": "--" if name in dashed else "-"} if dashed else {})
        for i, (name, label) in enumerate(labels.items())
    }
    columns = 3 if len(spreads) > 4 else 2
    figure, grid = new_panels(
        len(spreads), columns, 1.05, between=(0.25, 0.54), top=0.16, sharey=True
    )
    for axes, spread in zip(grid.flat, spreads, strict=False):
        for name, column in spread.values.items():
            axes.step(*distribution_steps(column), where="post", **looks[name])
        values = list(spread.values.values())
        make_value_axis(axes, spread.label, values, limits=spread.limits, unit=spread.unit)
    label_shares(grid)
    legend_below(figure, *grid.flat)
    return figure


_TEXT = FigureText(
    "distribution_asked",
    "Distributions of the required metrics",
    "Share of flights at or below each value. If a curve ends below 100 % (or begins above 0 %, if "
    "small values are bad), the other flights terminated early.",
)


def draw(_found: Metrics, names: Names) -> Iterator[Drawn]:
    """Yield the figure with the distributions of the leading metrics."""
    if names.asked:
        flights = {name: names.results.flights[name] for name in names.controllers}
        spreads = [make_spread(names.campaign, metric, flights) for metric in names.asked]
        colors = controller_colors(names.controllers)
        yield _TEXT, plot_distributions(spreads, names.controllers, colors)


def make_spread(
    campaign: Experiment, metric: str, flights: Mapping[str, ControllerFlights]
) -> Spread:
    """Return the values of a metric in the flights of each line of a figure."""
    record = campaign.metrics[metric]
    lost = -np.inf if record.bad == "low" else np.inf
    values = {
        name: np.where(table.failed, lost, table.metrics[metric]) for name, table in flights.items()
    }
    return Spread(
        record.label_with_unit, values, campaign.limits_of(metric), record.with_unit("").strip()
    )
