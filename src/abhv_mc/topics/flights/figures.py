"""The worst flights over the bands of all flights."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.folder.flown_campaign import read_histories
from abhv_mc.topics.figure_bands import EnvelopePanel, EnvelopeRow, off_reference, plot_envelopes, shown_bands
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.flights.model import Flights
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import FigureText

_CHANNELS = (
    ("altitude_m", "altitude error (m)", "altitude_reference_m"),
    ("angle_of_attack_deg", "angle of attack (deg)", ""),
    ("sideslip_deg", "sideslip (deg)", ""),
    ("bank_deg", "bank (deg)", ""),
)


def draw(found: Flights, names: Names) -> Iterator[tuple[FigureText, Figure]]:
    """The flights that are listed, as far as their histories are kept."""
    results, controllers = names.results, tuple(names.controllers)
    if not results.envelopes:
        return
    kept = {name: read_histories(results.folder, name) for name in controllers}
    listed = {name: [each.flight for each in found.worst[name] if each.flight in kept[name]] for name in controllers}
    if not any(listed.values()):
        return
    rows = []
    clock, campaign = results.reference.get("time", np.empty(0)), results.campaign
    users = [(each.name, each.axis, "") for each in campaign.channels[: len(_CHANNELS)]]
    for channel, label, given in users if campaign.user_model else _CHANNELS:
        panels, less = [], results.reference[given] if given else None
        for name in controllers:
            envelope = results.envelopes.get((name, channel))
            if envelope is None or (listed[name] and channel not in kept[name][listed[name][0]]):
                break
            curves: list[tuple[Floats, Floats]] = [
                (kept[name][k]["time"], off_reference(kept[name][k]["time"], kept[name][k][channel], clock, less))
                for k in listed[name]
            ]
            bands = {
                key: off_reference(envelope.time, band, clock, less)
                for key, band in shown_bands(envelope.bands, less).items()
            }
            panels.append(EnvelopePanel(envelope.time, bands, flights=curves))
        if len(panels) == len(controllers):
            rows.append(EnvelopeRow(label, panels))
    if rows:
        text = FigureText(
            "worst_flights",
            "The worst flights",
            f"The worst flight of each {campaign.kind}, and thin the next worst, over the bands of all flights; the "
            "tables above have their numbers.",
        )
        colors = controller_colors(controllers)
        yield text, plot_envelopes(rows, list(names.controllers.values()), list(colors.values()))
