"""Worst flights on search pages: channels over time, and commands to re-run them."""

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.parameters import Parameters
from abhv_mc.folder.flights import FlightRows
from abhv_mc.report.figures.searches import FLIGHT_PANELS, plot_flights
from abhv_mc.report.pages.page import make_table
from abhv_mc.search.search_flights import DRAWN_APART, DrawnFlights, rank_distinct
from abhv_mc.topics.flights.model import channel_of, limit_sides
from abhv_mc.topics.formatting import percent, shown_value
from abhv_mc.topics.missed_requirements import limit_words
from abhv_mc.topics.topic import Drawn, FigureText, Fold

_LISTED = 10
_PANELS = 6
_DISTINCT = (
    "The worst flight, and the worst flights whose parameters differ by at least "
    f"{100 * DRAWN_APART:g} % of the range (rms over the parameters) from all worse flights listed"
)


def flight_figures(
    drawn: DrawnFlights | None, metric: Metric, requirements: Sequence[Requirement]
) -> Iterator[Drawn]:
    """Yield the figure of the worst and nominal flights, if there are histories.

    The first panel shows the channel of the searched metric.
    """
    if drawn is None:
        return
    signals = {signal.name: (i, signal) for i, signal in enumerate(drawn.campaign.channels)}
    channel = channel_of(metric, signals, drawn.campaign.contents.stems)
    metric_panels = [
        (name, label, scale) for name, label, scale in FLIGHT_PANELS if name == channel
    ]
    if channel and not metric_panels:
        metric_panels = [(channel, signals[channel][1].axis, 1.0)]
    other_panels = [panel for panel in FLIGHT_PANELS if panel[0] != channel]
    panels = {
        label: drawn.history[:, :, signals[name][0]].astype(np.float64) * scale
        for name, label, scale in [*metric_panels, *other_panels][:_PANELS]
    }
    limits = [
        side * limit * metric_panels[0][2]
        for item in requirements
        for limit in item.limits.as_entry().values()
        for side in limit_sides(metric, signals)
    ]
    labels = ["nominal", *(f"flight {number}" for number in drawn.numbers)]
    caption = f"{_DISTINCT}, with the nominal flight. Each line ends when its flight ends."
    yield (
        FigureText("flights", "The worst flights", caption),
        plot_flights(drawn.times, panels, labels, limits=limits),
    )


def margin_text(requirement: Requirement, metric: Metric, worst: float) -> str:
    """Return a requirement with the worst value and its margin, which is negative if missed."""
    limits = requirement.limits
    margin = limits.limit - float(limits.worse(np.array([worst]))[0])
    text = f"{metric.with_unit(f'{worst:.5g}')}, required: {limit_words(metric, limits)}"
    if not limits.size or not np.isfinite(margin):
        return text
    return f"{text}, margin {percent(margin / limits.size, 2)}"


def flights_table(
    flights: FlightRows,
    severities: Floats,
    dimensions: int,
    metric: Metric,
    controller: str,
    *,
    folder: Path,
    parameters: Parameters,
) -> Fold:
    """Return the collapsible table of the worst flights, with commands to re-run them."""
    numbers = rank_distinct(
        severities, flights.samples[: len(severities), :dimensions], _LISTED, DRAWN_APART
    )
    command = shlex.join(["abhv-mc", "replay", str(folder), "--controller", controller, "--flight"])
    rows = [
        [
            str(k),
            f"{flights.column(metric.name)[k]:.5g}",
            f"{flights.outcome[k]}, {flights.end_time[k]:.4g} s",
            ", ".join(
                f"{name} {shown_value(name, x, parameters)}"
                for name, x in zip(
                    flights.names[:dimensions], flights.samples[k].tolist(), strict=False
                )
            ),
            f"`{command} {k}`",
        ]
        for k in numbers
    ]
    heads = ("flight", metric.label_with_unit, "end", "parameters", "command to re-run it")
    table = make_table("Worst flights", f"{_DISTINCT}.", heads, rows)
    return Fold("Worst flights and commands to re-run them", (table,))
