"""The worst flights over the bands of all flights."""

from collections.abc import Iterator
from dataclasses import replace

from matplotlib.figure import Figure

from abhv_mc.folder.flown_campaign import read_histories
from abhv_mc.topics.envelopes import curves_of
from abhv_mc.topics.envelopes.figures import flight_curve, panel_of
from abhv_mc.topics.figure_bands import EnvelopeRow, plot_envelopes
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.flights.model import Flights
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import FigureText

_CHANNELS = ("altitude_m", "angle_of_attack_deg", "sideslip_deg", "bank_deg")


def draw(found: Flights, names: Names) -> Iterator[tuple[FigureText, Figure]]:
    """The flights that are listed, as far as their histories are kept."""
    results, controllers = names.results, tuple(names.controllers)
    if not results.envelopes:
        return
    kept = {name: read_histories(results.folder, name) for name in controllers}
    listed = {
        name: [each.flight for each in found.worst[name] if each.flight in kept[name]]
        for name in controllers
    }
    if not any(listed.values()):
        return
    rows, reference, campaign = [], results.reference, results.campaign
    every = not campaign.simulator.capabilities.has_mission
    curves = [curve for curve in curves_of(campaign) if every or curve.channel in _CHANNELS]
    for curve in curves[: len(_CHANNELS)]:
        panels = []
        for name in controllers:
            envelope, histories = (
                results.envelopes.get((name, curve.channel)),
                [kept[name][k] for k in listed[name]],
            )
            if envelope is None or (histories and curve.channel not in histories[0]):
                break
            panel = panel_of((envelope.time, envelope.bands), curve, reference)
            flown = [flight_curve(each, curve, reference) for each in histories]
            panels.append(replace(panel, reference=None, flights=flown))
        if len(panels) == len(controllers):
            rows.append(EnvelopeRow(curve.label, panels))
    if rows:
        text = FigureText(
            "worst_flights",
            "The worst flights",
            f"The worst flight of each {campaign.kind}, and thin the next worst, over the bands of all flights; the "
            "tables above have their numbers.",
        )
        colors = controller_colors(controllers)
        yield text, plot_envelopes(rows, list(names.controllers.values()), list(colors.values()))
