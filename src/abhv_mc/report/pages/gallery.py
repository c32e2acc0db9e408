"""All figures of a report, in its order, each with its words."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.flight.metrics import SURFACE_USAGE
from abhv_mc.folder.results import Results, read_histories
from abhv_mc.report.figures.distributions import Spread, Trade, plot_distributions, plot_error_against_usage
from abhv_mc.report.numbers.paired import total_usage
from abhv_mc.topics.envelopes import ENVELOPES
from abhv_mc.topics.figure_bands import EnvelopePanel, EnvelopeRow, off_reference, plot_envelopes, shown_bands
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.registry import all_topics
from abhv_mc.topics.section import FigureText
from abhv_mc.topics.topic import Models


def _spread(results: Results, metric: str) -> Spread:
    flown = {name: results.flights[name] for name in results.controllers}
    record = results.campaign.metrics[metric]
    lost = -np.inf if record.bad == "low" else np.inf
    values = {name: np.where(flights.failed, lost, flights.metrics[metric]) for name, flights in flown.items()}
    limits = results.campaign.limits_of(metric)
    return Spread(record.label_with_unit, values, limits)


_ASKED_TEXT = FigureText(
    "distribution_asked",
    "What is asked, over the flights",
    "Share of flights at or below each value. A curve that ends below 100 % had flights that ended early; where small "
    "values are bad, one that begins above 0 %.",
)
_MOST_TRADES = 3


def _distributions(results: Results, labels: Mapping[str, str], colors: Mapping[str, str]) -> Iterator[Any]:
    if results.asked:
        spreads = [_spread(results, metric) for metric in results.asked]
        yield _ASKED_TEXT, plot_distributions(spreads, labels, colors)


def _trade(results: Results, labels: Mapping[str, str], colors: Mapping[str, str]) -> Iterator[Any]:
    records = results.campaign.metrics
    errors = [metric for metric in results.asked if records[metric].group == "tracking"][:_MOST_TRADES]
    if not errors or not set(SURFACE_USAGE) <= set(results.metrics):
        return
    flights = {name: results.flights[name] for name in results.controllers}
    flown = {name: ~table.failed for name, table in flights.items()}
    usage = {name: total_usage(table.metrics)[flown[name]] for name, table in flights.items()}
    trades = [
        Trade(records[m].label_with_unit, {name: table.metrics[m][flown[name]] for name, table in flights.items()})
        for m in errors
    ]
    text = FigureText(
        "error_against_usage",
        "Tracking error against control usage",
        "Each small mark is one flight, each large one a controller's median. Usage is the root of the summed squares "
        "of the rms deflections of aileron, rudder and elevator from their trim. Lower is better at equal usage.",
    )
    yield text, plot_error_against_usage(usage, trades, "surface usage, rms (deg)", labels, colors)


_WORST_CHANNELS = (
    ("altitude_m", "altitude error (m)", "altitude_reference_m"),
    ("angle_of_attack_deg", "angle of attack (deg)", ""),
    ("sideslip_deg", "sideslip (deg)", ""),
    ("bank_deg", "bank (deg)", ""),
)


def _worst(
    results: Results, numbers: Mapping[str, Any], labels: Mapping[str, str], colors: Mapping[str, str]
) -> Iterator[Any]:
    names = results.controllers
    kept = {name: read_histories(results.folder, name) for name in names}
    listed = {name: [e["flight"] for e in numbers["worst"][name] if e["flight"] in kept[name]] for name in names}
    if not any(listed.values()):
        return
    rows = []
    clock = results.reference["time"]
    for channel, label, given in _WORST_CHANNELS:
        panels, less = [], results.reference[given] if given else None
        for name in names:
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
        if len(panels) == len(names):
            rows.append(EnvelopeRow(label, panels))
    if rows:
        flown = "; ".join(f"{labels[name]}: {', '.join(map(str, listed[name]))}" for name in names if listed[name])
        text = FigureText(
            "worst_flights",
            "The worst flights",
            f"The worst flights, over the bands of all flights. Flights of {flown}.",
        )
        yield text, plot_envelopes(rows, list(labels.values()), list(colors.values()))


def make_figures(models: Models, numbers: Mapping[str, Any]) -> dict[str, Iterator[tuple[FigureText, Figure]]]:
    """Every figure that the campaign's folder has the data for, by what it shows."""
    results = models.results
    labels = numbers["campaign"]["labels"]
    colors = controller_colors(results.controllers)
    topics = {topic.name: models.figures(topic) for topic in all_topics()}
    return {
        ENVELOPES.name: topics.pop(ENVELOPES.name),
        "distributions": _distributions(results, labels, colors),
        "error against usage": _trade(results, labels, colors),
        "worst flights": _worst(results, numbers, labels, colors),
        **topics,
    }
