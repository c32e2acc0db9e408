"""Figures of all channels over time: envelopes over all flights, or single flights."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.search.place import find_band
from abhv_mc.topics.envelopes import CURVES, Curve, Envelopes, curves_of
from abhv_mc.topics.figure_bands import (
    SIMULTANEOUS,
    EnvelopePanel,
    EnvelopeRow,
    bands_off,
    off_reference,
    plot_sheet,
)
from abhv_mc.topics.topic import Drawn, FigureText, Names

Bands = tuple[Floats, Mapping[str, Floats]]  # a channel's times [time], and its bands by name
# function that returns the bands of a channel under a controller, or None
Find = Callable[[str, str], Bands | None]

# limits of requirements on a channel: times in s, and levels [time]
Limits = Mapping[str, Sequence[tuple[Floats, Floats]]]

_VARYING = " The altitude error has no band of all flights, because the reference altitude varies."
_SIMULTANEOUS = (
    " With 95 % probability, a whole flight stays between the dotted lines in all channels."
)


def draw(_found: Envelopes, names: Names) -> Iterator[Drawn]:
    """Yield the figure of all channels that have envelopes."""
    controllers, campaign, results = tuple(names.controllers), names.campaign, names.results

    simultaneous = {name: _simultaneous(results, name) for name in controllers}

    def find(controller: str, channel: str) -> Bands | None:
        envelope = results.envelopes.get((controller, channel))
        if envelope is None or not np.isfinite(envelope.median).any():
            return None
        return envelope.time, {**envelope.bands, **simultaneous[controller].get(channel, {})}

    if rows := _rows(find, controllers, results.reference, curves_of(campaign)):
        first = names.label(controllers[0])
        varies = np.ptp(results.reference.get("altitude_reference_m", np.zeros(1))) > 0.0
        text = FigureText(
            "channels",
            "The channels over all flights",
            f"The bands of {first} are filled."
            + (
                f" Thin lines are the edges of the other {campaign.kind}s' bands: pale for all "
                "flights, dark for 5\N{EN DASH}95\N{NARROW NO-BREAK SPACE}%."
                if len(controllers) > 1
                else ""
            )
            + (" Insets enlarge the shaded times." if any(row.inset for row in rows) else "")
            + (_VARYING if varies else "")
            + (_SIMULTANEOUS if any(simultaneous.values()) else ""),
        )
        yield text, plot_sheet(rows, list(names.controllers.values()))


def _simultaneous(results: FlownCampaign, controller: str) -> dict[str, dict[str, Floats]]:
    """Return the edges of the simultaneous band of each channel under one controller.

    The result is empty if no histories of randomly sampled flights are stored.
    """
    recorded = [
        curve.channel
        for curve in curves_of(results.campaign)
        if (controller, curve.channel) in results.envelopes
    ]
    if not recorded:
        return {}
    times = results.envelopes[controller, recorded[0]].time
    shared_band = find_band(results, controller, recorded, times)
    if shared_band is None:
        return {}
    shared, band = shared_band
    low, high = band.edges
    return {
        name: dict(zip(SIMULTANEOUS, (low[:, k], high[:, k]), strict=True))
        for k, name in enumerate(shared)
    }


def plot_flown(
    flights: Mapping[str, Mapping[str, Floats]],
    reference: Mapping[str, Floats],
    curves: Sequence[Curve] = CURVES,
    limits: Limits = MappingProxyType({}),
) -> Figure:
    """Plot single flights; ``flights`` maps labels to channels [time]."""

    def find(label: str, channel: str) -> Bands | None:
        flight = flights[label]
        return (flight["time"], {"q50": flight[channel]}) if channel in flight else None

    return plot_sheet(_rows(find, tuple(flights), reference, curves, limits), list(flights))


def _rows(
    find: Find,
    names: Sequence[str],
    reference: Mapping[str, Floats],
    curves: Sequence[Curve],
    limits: Limits = MappingProxyType({}),
) -> list[EnvelopeRow]:
    """Return rows of panels: the ground track (only with a reference), then all channels."""
    track = [
        _track(find(name, "east_m"), find(name, "north_m"), reference)
        for name in names
        if reference
    ]
    rows = [EnvelopeRow("north (km)", [panel for panel in track if panel], across="east (km)")]
    for curve in curves:
        panels = [
            replace(panel_of(channel_bands, curve, reference), limits=limits.get(curve.channel, ()))
            for name in names
            if (channel_bands := find(name, curve.channel))
        ]
        rows.append(EnvelopeRow(curve.label, panels, inset=curve.needles))
    return [row for row in rows if len(row.panels) == len(names)]


def panel_of(channel_bands: Bands, curve: Curve, reference: Mapping[str, Floats]) -> EnvelopePanel:
    """Return a channel's panel; subtract the reference if ``curve.off_reference`` is true."""
    time, bands = channel_bands
    reference_values = reference[curve.reference] if curve.reference else None
    clock, less = reference.get("time", time), reference_values if curve.off_reference else None
    reference_curve = (
        None
        if reference_values is None
        else (clock, off_reference(clock, reference_values, clock, less))
    )
    return EnvelopePanel(time, bands_off(time, bands, clock, less), reference=reference_curve)


def flight_curve(
    history: Mapping[str, Floats], curve: Curve, reference: Mapping[str, Floats]
) -> tuple[Floats, Floats]:
    """Return the times and values of a channel; ``off_reference`` subtracts the reference."""
    time, values = history["time"], history[curve.channel]
    less = reference[curve.reference] if curve.off_reference else None
    return time, off_reference(time, values, reference.get("time", time), less)


def _track(
    east: Bands | None, north: Bands | None, reference: Mapping[str, Floats]
) -> EnvelopePanel | None:
    """Return the panel of the ground track: north against median east position in km."""
    if east is None or north is None:
        return None
    reference_track = reference["east_reference_m"] / 1e3, reference["north_reference_m"] / 1e3
    return EnvelopePanel(
        east[1]["q50"] / 1e3,
        {k: band / 1e3 for k, band in north[1].items()},
        reference=reference_track,
    )
