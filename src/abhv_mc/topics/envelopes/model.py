"""How far each channel goes, over the flights that the envelopes are of; and the report's section."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.topics.names import Names
from abhv_mc.topics.plain import DRAWN
from abhv_mc.topics.section import Gallery, Heading, Item, Section, Text, Widget
from abhv_mc.topics.words import fixed


@dataclass(frozen=True)
class Envelopes:
    """Smallest and largest value of each channel over the flights and times."""

    ranges: Mapping[str, Mapping[str, tuple[float, float]]]  # controller -> channel
    step_s: float | None  # between the samples of the bands
    flights: int  # of each controller, the first ones
    source: FlownCampaign = field(repr=False, metadata={DRAWN: True})


def compute_envelopes(results: FlownCampaign) -> Envelopes:
    """The ranges of every channel of which a flight was computed."""
    ranges: dict[str, dict[str, tuple[float, float]]] = {}
    flights = 0
    for (controller, channel), envelope in results.envelopes.items():
        low, high = envelope.bands["min"], envelope.bands["max"]
        flights = max(flights, int(envelope.count.max(initial=0)))
        if not np.isnan(low).all():
            ranges.setdefault(controller, {})[channel] = float(np.nanmin(low)), float(np.nanmax(high))
    times = next((envelope.time for envelope in results.envelopes.values() if envelope.time.size > 1), None)
    return Envelopes(ranges, None if times is None else float(times[1] - times[0]), flights, results)


def range_words(found: Envelopes, names: Names, channel: str, unit: str) -> str:
    """'TLC 19,990 to 20,012 m; LQR ...'; '' where no flight has the channel."""
    parts = [
        f"{names.label(name)} {_ends(*ranges[channel])}{' ' + unit if unit else ''}"
        for name, ranges in found.ranges.items()
        if channel in ranges
    ]
    return "; ".join(parts)


def _ends(low: float, high: float) -> str:
    """Both ends of a range, to a thousandth of the range but no finer than four digits of the larger."""
    spread = high - low
    places = 2 if spread <= 0.0 else max(0, 2 - len(str(int(spread)))) if spread >= 1.0 else 3
    return f"{fixed(low, places)} to {fixed(high, places)}"


def envelope_section(found: Envelopes, _names: Names) -> Section:
    """What bands are, the interactive ones, and the figures."""
    items: list[Item] = []
    campaign = found.source.campaign
    if not campaign.has_histories:
        text = "The simulator returns no histories: there are no bands over time and no curves of single flights."
        return Section("Bands over time", (Text(text),))
    if found.step_s is not None:
        flown = max(flights.flight.size for flights in found.source.flights.values())
        of = "" if found.flights >= flown else f" of flights 0 to {found.flights - 1}"
        items.append(
            Text(
                "Bands, here and in the figures below, are pointwise quantiles over the flights still airborne"
                f'{of}: no single flight need follow one. "All flights" is the smallest and largest value at any '
                f"control tick; the other bands are of samples {found.step_s:.4g} s apart."
            )
        )
        points = len(campaign.unknowns.points)
        if points > 1:
            items.append(
                Text(
                    f"The unknowns have one value for the whole programme: each band goes from the least to the most "
                    f"quantile over their {points} points, with {found.flights // points:,} flights at each, and the "
                    "median has two lines. Between them one cannot say where it lies; commands are drawn midway."
                )
            )
    what = "The channels over the flights"
    if campaign.figures == "paper":
        what = "The paper's Figures 2 to 11 (Zhu and Shen 2014), here over the flights"
    words = f"{what}. They lie beside this page in `figures/`, fit for print."
    return Section("Bands over time", (*items, Widget("bands"), Heading("Figures"), Text(words), Gallery()))
