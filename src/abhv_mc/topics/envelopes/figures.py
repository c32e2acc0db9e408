"""Channels on one sheet: bands over all flights, or single flights."""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.analysis.place import find_band
from abhv_mc.array_types import Floats
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.topics.envelopes import CURVES, Curve, Envelopes, curves_of
from abhv_mc.topics.figure_bands import (
    SIMULTANEOUS,
    EnvelopePanel,
    EnvelopeRow,
    bands_off,
    off_reference,
    plot_sheet,
)
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import FigureText

Bands = tuple[Floats, Mapping[str, Floats]]  # time and bands of a channel
Find = Callable[[str, str], Bands | None]  # of a controller and a channel

_OURS = "; insets show the largest move. The altitude error has no band of all flights where the reference climbs"

_SIMULTANEOUS = (
    " Between the dotted lines a whole flight lies in all channels, at all times, with 95 %."
)


def draw(_found: Envelopes, names: Names) -> Iterator[tuple[FigureText, Figure]]:
    """One sheet of the channels that the envelopes hold."""
    controllers, campaign, results = tuple(names.controllers), names.campaign, names.results

    simultaneous = {name: _simultaneous(results, name) for name in controllers}

    def find(controller: str, channel: str) -> Bands | None:
        envelope = results.envelopes.get((controller, channel))
        if envelope is None or not np.isfinite(envelope.median).any():
            return None
        return envelope.time, {**envelope.bands, **simultaneous[controller].get(channel, {})}

    if rows := _rows(find, controllers, results.reference, curves_of(campaign)):
        ours = _OURS if campaign.simulator.capabilities.has_mission else ""
        words = FigureText(
            "channels",
            "The channels over all flights",
            f"Bands of all {campaign.kind}s in the same axes{ours}."
            + (_SIMULTANEOUS if any(simultaneous.values()) else ""),
            alt="The table above has the smallest and the largest value of each channel.",
        )
        yield words, plot_sheet(rows, names.controllers, controller_colors(controllers))


def _simultaneous(results: FlownCampaign, controller: str) -> dict[str, dict[str, Floats]]:
    """Return the edges of the simultaneous band by channel; none without histories of random flights."""
    channels = [curve.channel for curve in curves_of(results.campaign)]
    held = [name for name in channels if (controller, name) in results.envelopes]
    if not held:
        return {}
    times = results.envelopes[controller, held[0]].time
    found = find_band(results, controller, held, times)
    if found is None:
        return {}
    shared, band = found
    low, high = (band.middle + side * band.factor * band.spread for side in (-1.0, 1.0))
    return {
        name: dict(zip(SIMULTANEOUS, (low[:, k], high[:, k]), strict=True))
        for k, name in enumerate(shared)
    }


def plot_flown(
    flights: Mapping[str, Mapping[str, Floats]],
    reference: Mapping[str, Floats],
    labels: Mapping[str, str],
) -> Figure:
    """The sheet of one flight of each controller; all columns [time] by channel."""

    def find(controller: str, channel: str) -> Bands:
        return flights[controller]["time"], {"q50": flights[controller][channel]}

    return plot_sheet(
        _rows(find, tuple(flights), reference, CURVES), labels, controller_colors(tuple(flights))
    )


def _rows(
    find: Find, names: Sequence[str], reference: Mapping[str, Floats], curves: Sequence[Curve]
) -> list[EnvelopeRow]:
    """The ground track where it has a reference, then the channels that every controller has."""
    track = [
        _track(find(name, "east_m"), find(name, "north_m"), reference)
        for name in names
        if reference
    ]
    rows = [EnvelopeRow("north over east (km)", [each for each in track if each])]
    for curve in curves:
        panels = [
            panel_of(held, curve, reference)
            for name in names
            if (held := find(name, curve.channel))
        ]
        rows.append(EnvelopeRow(curve.label, panels, inset=curve.needles))
    return [row for row in rows if len(row.panels) == len(names)]


def panel_of(held: Bands, curve: Curve, reference: Mapping[str, Floats]) -> EnvelopePanel:
    """A channel's bands and its reference, both off the reference where the curve is."""
    time, given = held[0], reference[curve.reference] if curve.reference else None
    clock, less = reference.get("time", time), given if curve.off_reference else None
    shown = None if given is None else (clock, off_reference(clock, given, clock, less))
    return EnvelopePanel(time, bands_off(time, held[1], clock, less), reference=shown)


def flight_curve(
    history: Mapping[str, Floats], curve: Curve, reference: Mapping[str, Floats]
) -> tuple[Floats, Floats]:
    """A flight's channel over time as its curve is drawn."""
    time, values = history["time"], history[curve.channel]
    less = reference[curve.reference] if curve.off_reference else None
    return time, off_reference(time, values, reference.get("time", time), less)


def _track(
    east: Bands | None, north: Bands | None, reference: Mapping[str, Floats]
) -> EnvelopePanel | None:
    """North at each moment, against the median way east."""
    if east is None or north is None:
        return None
    given = reference["east_reference_m"] / 1e3, reference["north_reference_m"] / 1e3
    return EnvelopePanel(
        east[1]["q50"] / 1e3, {k: band / 1e3 for k, band in north[1].items()}, reference=given
    )
