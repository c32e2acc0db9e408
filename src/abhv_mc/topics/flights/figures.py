"""Figure of the worst flights, showing the channels of their worst metrics."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.flights.metrics import Metric, label_of
from abhv_mc.folder.flown_campaign import read_histories, read_replayed
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.topics.envelopes import Curve, curves_of
from abhv_mc.topics.envelopes.figures import flight_curve, panel_of, plot_flown
from abhv_mc.topics.figure_bands import (
    EnvelopePanel,
    EnvelopeRow,
    off_reference,
    plot_envelopes,
    plot_errors,
)
from abhv_mc.topics.figure_style import controller_colors, legend_below, new_figure, styled
from abhv_mc.topics.flights.model import Flights, WorstFlight, channel_of, limit_sides
from abhv_mc.topics.topic import Drawn, FigureText, Names

_MOST_CHANNELS = 4


def draw(flights: Flights, names: Names) -> Iterator[Drawn]:
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
    yield from _ground_tracks(names, kept_histories)
    for path in CampaignFolder(results.folder).replayed_files():
        yield draw_replayed(path, names)
    if not any(histories.values()):
        return
    yield from _critical(flights, names, kept_histories)
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


def draw_replayed(path: Path, names: Names) -> Drawn:
    """Return the figure of a re-run flight beside the nominal flight and the reference."""
    results, (controller, flight, history) = names.results, read_replayed(path)
    shown = {f"flight {flight}": history, "nominal": results.nominal.get(controller)}
    aligned = {
        label: results.align(controller, own) for label, own in shown.items() if own is not None
    }
    text = FigureText(
        f"replayed_{path.stem}",
        f"Flight {flight} of {names.label(controller)}",
        "Re-run flight and nominal flight, with the reference and the limits.",
    )
    limits = {channel: _limits(channel, names, {*history}) for channel in history}
    limited = (_curve(channel, names) for channel, own in limits.items() if own)
    # An error with a limit replaces the curve with the same label.
    curves = {curve.label: curve for curve in (*curves_of(names.campaign), *limited)}
    return text, plot_flown(aligned, results.reference, tuple(curves.values()), limits)


def _ground_tracks(
    names: Names, histories: Mapping[str, Mapping[int, Mapping[str, Floats]]]
) -> Iterator[Drawn]:
    """Yield the map of the stored ground tracks, if the campaign has keep-out zones."""
    zones = names.campaign.contents.zones
    if not zones:
        return
    colors, tracks = controller_colors(names.controllers), []
    for name, own in histories.items():
        for history in own.values():
            if {"latitude_deg", "longitude_deg"} <= history.keys():
                tracks.append((names.label(name), colors[name], history))
    yield (
        FigureText(
            "ground_tracks",
            "Ground tracks and keep-out zones",
            f"Flights with stored histories; zones: {', '.join(zones)}. The axes differ in scale.",
        ),
        plot_tracks(list(zones.values()), tracks),
    )


@styled
def plot_tracks(
    zones: Sequence[Floats], tracks: Sequence[tuple[str, str, Mapping[str, Floats]]]
) -> Figure:
    """Return the map of zones [point, 2] (deg) and of labelled, coloured histories."""
    figure = new_figure(height=3.2)
    axis = figure.subplots()
    for outline in zones:
        axis.fill(outline[:, 1], outline[:, 0], facecolor="0.85", edgecolor="0.3", hatch="///")
    labels = set[str]()
    for label, color, history in tracks:
        own = "_" if label in labels else label
        labels.add(label)
        axis.plot(history["longitude_deg"], history["latitude_deg"], color=color, lw=0.6, label=own)
    axis.set(xlabel="longitude (deg)", ylabel="latitude (deg)")
    legend_below(figure, axis)
    return figure


def _critical(
    flights: Flights, names: Names, histories: Mapping[str, Mapping[int, Mapping[str, Floats]]]
) -> Iterator[Drawn]:
    """Yield the figure of the most critical error of each controller, with its limit."""
    panels = []
    for name, color in controller_colors(names.controllers).items():
        worst = next((f for f in flights.worst[name] if f.flight in histories[name]), None)
        if worst is None:
            continue
        history = histories[name][worst.flight]
        metric = worst.by or _ended_by(worst, names, history) or names.asked[0]
        record = names.metrics[metric]
        channel = channel_of(record, history, names.campaign.contents.stems)
        if channel is not None:
            error = _error_of(channel, record, names, history)
            title = f"{names.label(name)}, flight {worst.flight}"
            limits = _limit_curves(metric, names)
            unit = record.with_unit("").strip()
            own = record.of == channel
            label = label_of(channel, record.unit) if own else record.label.partition(", ")[0]
            label = f"{label} ({unit})" if unit else label
            panels.append(
                (title, label, color, EnvelopePanel(error[0], {}, flights=[error], limits=limits))
            )
    if panels:
        text = FigureText(
            "critical_errors",
            f"Most critical error and limit in the worst flight of each {names.campaign.kind}",
            "",
        )
        yield text, plot_errors(panels)


def _ended_by(worst: WorstFlight, names: Names, history: Collection[str]) -> str | None:
    """Return the leading metric whose channel ended a flight early, if the outcome names it."""
    stem = worst.outcome.removesuffix("_limit")
    stems = names.campaign.contents.stems
    channels = {metric: channel_of(names.metrics[metric], history, stems) for metric in names.asked}
    return next((m for m, channel in channels.items() if (channel or "").startswith(stem)), None)


def _error_of(
    channel: str, record: Metric, names: Names, history: Mapping[str, Floats]
) -> tuple[Floats, Floats]:
    """Return times and values of a metric's source, or of its channel minus the command."""
    time, values = history["time"], history[channel]
    if record.of == channel:
        return time, values
    stem, _, unit = channel.rpartition("_")
    command, reference = history.get(f"{stem}_command_{unit}"), names.results.reference
    if command is not None:
        return time, values - command
    return time, off_reference(
        time, values, reference.get("time", time), reference.get(f"{stem}_reference_{unit}")
    )


def worst_channels(flights_model: Flights, names: Names, recorded: set[str]) -> list[str]:
    """Return the channels of the flights' worst metrics, most frequent first.

    An early termination counts for the channel whose limit ended the flight, if the outcome names
    this channel.
    """
    count: Counter[str] = Counter()
    for flight in (flight_record for own in flights_model.worst.values() for flight_record in own):
        if flight.by is not None:
            channel = channel_of(names.metrics[flight.by], recorded, names.campaign.contents.stems)
        else:
            stem = flight.outcome.removesuffix("_limit")
            channel = next((c for c in sorted(recorded) if c.rpartition("_")[0] == stem), None)
        if channel is not None:
            count[channel] += 1
    return sorted(count, key=lambda channel: (-count[channel], channel)) or [
        curve.channel for curve in curves_of(names.campaign) if curve.channel in recorded
    ]


def _curve(channel: str, names: Names) -> Curve:
    """Return the display settings of a channel."""
    curves = {curve.channel: curve for curve in curves_of(names.campaign)}
    (unit,) = (signal.unit for signal in names.campaign.channels if signal.name == channel)
    label = names.campaign.contents.stems.get(channel, channel) if unit != "-" else channel
    label = label.replace("_", " ")
    return curves.get(channel) or Curve(channel, f"{label} ({unit})".replace("(-)", "(–)"))


def _limits(channel: str, names: Names, recorded: set[str]) -> tuple[tuple[Floats, Floats], ...]:
    """Return the limits of requirements on a channel: times in s, and levels [time].

    A level is NaN when the requirement does not apply.
    """
    metrics = dict.fromkeys(item.metric for item in names.requirements)
    stems = names.campaign.contents.stems
    return tuple(
        curve
        for metric in metrics
        if names.metrics[metric].of in recorded
        and channel_of(names.metrics[metric], recorded, stems) == channel
        for curve in _limit_curves(metric, names)
    )


def _limit_curves(name: str, names: Names) -> tuple[tuple[Floats, Floats], ...]:
    """Return the limits of a metric: times in s, and levels [time], NaN where not applicable."""
    clock, metric = names.results.reference.get("time"), names.metrics[name]
    time = np.array([metric.start, metric.end]) if clock is None else clock
    applies = (time >= metric.start) & (time <= metric.end)
    for first, end in names.campaign.transients if metric.settled else ():
        applies &= (time < first) | (time >= end)
    return tuple(
        (time, np.where(applies, side * limit, np.nan))
        for limit in names.campaign.limits_of(name)
        for side in limit_sides(metric, {metric.of})
    )
