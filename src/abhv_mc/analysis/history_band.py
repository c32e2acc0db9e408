"""Simultaneous band of the stored histories of a campaign."""

from collections.abc import Mapping, Sequence

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.folder.flown_campaign import FlownCampaign, read_histories
from abhv_mc.statistics.circular import align_flights, unwrap
from abhv_mc.statistics.placement import CONFIDENCE, Band, simultaneous_band

FEWEST_FLIGHTS = 39  # minimum number of flights for a simultaneous 95 % band


def _sample(
    history: Mapping[str, Floats],
    channels: Sequence[str],
    times: Floats,
    periods: Mapping[str, float],
) -> Floats:
    """Interpolate channels at `times` [time, channel], with NaN outside the history."""
    curves = [unwrap(history[channel], periods[channel]) for channel in channels]
    return np.column_stack(
        [np.interp(times, history["time"], curve, np.nan, np.nan) for curve in curves]
    )


def _random_histories(results: FlownCampaign, controller: str) -> dict[int, dict[str, Floats]]:
    """Return, by flight number, the histories that were stored regardless of the outcome."""
    steps = [
        1 if item == "all" else int(str(item).removeprefix("every "))
        for item in results.campaign.model.keep.histories.flights
        if str(item) == "all" or str(item).startswith("every ")
    ]
    stored = read_histories(results.folder, controller) if steps else {}
    return {k: stored[k] for k in sorted(stored) if any(k % step == 0 for step in steps)}


def find_band(
    results: FlownCampaign, controller: str, channels: Sequence[str], times: Floats
) -> tuple[list[str], Band] | None:
    """Return the channels that have histories, and the simultaneous band of these channels.

    Return None if there is no such channel or if there are too few random histories.
    """
    if not results.campaign.independent:
        return None
    histories = list(_random_histories(results, controller).values())
    shared = [name for name in channels if histories and name in histories[0]]
    if len(histories) < FEWEST_FLIGHTS or not shared:
        return None
    periods = results.campaign.periods
    sampled = np.stack([_sample(history, shared, times, periods) for history in histories])
    for c, channel in enumerate(shared):
        sampled[:, :, c] = align_flights(sampled[:, :, c], periods[channel])
    return shared, simultaneous_band(sampled, CONFIDENCE)
