"""How far each channel goes, over the flights that the envelopes are of."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from abhv_mc.folder import envelope_states
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.topics.plain import DRAWN


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
    for (controller, channel), envelope in results.envelopes.items():
        low, high = envelope.bands["min"], envelope.bands["max"]
        if not np.isnan(low).all():
            ranges.setdefault(controller, {})[channel] = float(np.nanmin(low)), float(np.nanmax(high))
    times = next((envelope.time for envelope in results.envelopes.values() if envelope.time.size > 1), None)
    flown = max((int(each.flight.max(initial=-1)) + 1 for each in results.flights.values()), default=0)
    flights = min(flown, envelope_states.ENVELOPE_FLIGHTS)
    return Envelopes(ranges, None if times is None else float(times[1] - times[0]), flights, results)
