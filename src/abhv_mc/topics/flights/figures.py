"""Figure of the worst flights, showing the channels of their worst metrics."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.flight.metrics import name_end
from abhv_mc.folder.flown_campaign import read_histories
from abhv_mc.topics.envelopes import Curve, curves_of
from abhv_mc.topics.envelopes.figures import flight_curve, panel_of
from abhv_mc.topics.figure_bands import EnvelopePanel, EnvelopeRow, plot_envelopes
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.flights.model import Flights, channel_of, limit_sides
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import FigureText

_MOST_CHANNELS = 4


def draw(flights: Flights, names: Names) -> Iterator[tuple[FigureText, Figure]]:
    """Yield the figure of the listed flights that have stored histories."""
    results, controllers = names.results, tuple(names.controllers)
    kept_histories = {name: read_histories(results.folder, name) for name in controllers}
    listed = {
        name: [
            history.flight
            for history in flights.worst[name]
            if history.flight in kept_histories[name]
        ]
        for name in controllers
    }
    histories = {
        name: [results.align(name, kept_histories[name][k]) for k in listed[name]]
        for name in controllers
    }
    if not any(histories.values()):
        return
    recorded = set.intersection(*({*history} for own in histories.values() for history in own))
    rows, reference = [], results.reference
    for channel in worst_channels(flights, names, recorded)[:_MOST_CHANNELS]:
        curve, panels, limits = _curve(channel, names), [], _limits(channel, names, recorded)
        for name in controllers:
            envelope = results.envelopes.get((name, channel))
            if envelope:
                panel = panel_of((envelope.time, envelope.bands), curve, reference)
            elif histories[name]:
                panel = EnvelopePanel(histories[name][0]["time"], {})
            else:
                break
            flown = [flight_curve(history, curve, reference) for history in histories[name]]
            panels.append(replace(panel, reference=None, flights=flown, limits=limits))
        if len(panels) == len(controllers):
            rows.append(EnvelopeRow(curve.label, panels))
    if rows:
        panels = [panel for row in rows for panel in row.panels]
        most = max(len(panel.flights) for panel in panels) - 1
        text = FigureText(
            "worst_flights",
            "The worst flights",
            f"Each column shows the worst flights of one {names.campaign.kind}: the worst in "
            "colour"
            + (f", and up to {most} of the next worst as thin lines" if most else "")
            + ". Rows are the channels of the metrics in which these flights are worst."
            + (" Bands contain all flights." if any(panel.bands for panel in panels) else "")
            + (
                " The requirement excludes the shaded transients."
                if any(panel.excluded for panel in panels)
                else ""
            ),
        )
        colors = controller_colors(controllers)
        yield text, plot_envelopes(rows, list(names.controllers.values()), list(colors.values()))


def worst_channels(flights_model: Flights, names: Names, recorded: set[str]) -> list[str]:
    """Return the channels of the flights' worst metrics, most frequent first.

    An early termination counts for the channel whose limit ended the flight, if the outcome names
    this channel.
    """
    count: Counter[str] = Counter()
    for flight in (flight_record for own in flights_model.worst.values() for flight_record in own):
        if flight.by is not None:
            channel = channel_of(names.metrics[flight.by], recorded)
        else:
            stem = flight.outcome.removesuffix("_limit")
            channel = next((name for name in recorded if name.rpartition("_")[0] == stem), None)
        if channel is not None:
            count[channel] += 1
    return [channel for channel, _ in count.most_common()] or [
        curve.channel for curve in curves_of(names.campaign) if curve.channel in recorded
    ]


def _curve(channel: str, names: Names) -> Curve:
    """Return the display settings of a channel."""
    curves = {curve.channel: curve for curve in curves_of(names.campaign)}
    signals = {signal.name: signal for signal in names.campaign.channels}
    return curves.get(channel) or Curve(channel, _axis(channel, signals[channel].unit))


def _axis(channel: str, unit: str) -> str:
    """Return an axis label such as 'speed error (m/s)'."""
    name = channel.removesuffix(f"_{name_end(unit)}") if name_end(unit) else channel
    return f"{name.replace('_', ' ')} ({unit})".replace("(-)", "(–)")


def _limits(channel: str, names: Names, recorded: set[str]) -> tuple[tuple[Floats, Floats], ...]:
    """Return the limits of requirements on a channel: times in s, and levels [time].

    A level is NaN when the requirement does not apply.
    """
    clock = names.results.reference.get("time")
    limits = []
    for name in dict.fromkeys(item.metric for item in names.requirements):
        metric = names.metrics[name]
        if channel_of(metric, recorded) != channel:
            continue
        time = np.array([metric.start, metric.end]) if clock is None else clock
        applies = (time >= metric.start) & (time <= metric.end)
        for first, end in names.campaign.simulator.find_transients() if metric.settled else ():
            applies &= (time < first) | (time >= end)
        limits += [
            (time, np.where(applies, side * limit, np.nan))
            for limit in names.campaign.limits_of(name)
            for side in limit_sides(metric, recorded)
        ]
    return tuple(limits)
