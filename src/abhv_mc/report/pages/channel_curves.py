"""Envelopes and nominal flights of channels over time, for the interactive views."""

from collections.abc import Collection, Mapping

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.signals import Signal
from abhv_mc.folder.flown_campaign import BANDS, FlownCampaign
from abhv_mc.topics.figure_bands import bands_off

_MOST_TIMES = 301
# Tracking errors that equal a channel minus its reference, which is the same for all flights.
_OFF_REFERENCE = {
    "altitude_error_m": ("altitude_m", "altitude_reference_m"),
    "speed_error_mps": ("speed_mps", "speed_reference_mps"),
}


def describe_channel(
    name: str, recorded: Collection[str], campaign: Experiment
) -> dict[str, str | None]:
    """Return a channel's label, unit, description and, if it is ``recorded``, command channel."""
    unknown = Signal(name, "-", "")
    signal = next((item for item in campaign.channels if item.name == name), unknown)
    command = _beside(signal, "command")
    label = signal.name if signal.unit == "-" else campaign.contents.stems.get(name, name)
    return {
        "name": name,
        "label": (label[:1].upper() + label[1:]).replace("_", " "),
        "unit": "" if signal.unit == "-" else signal.unit,
        "doc": signal.doc,
        "command": command if command in recorded else None,
    }


def _beside(signal: Signal, kind: str) -> str:
    """Return the name of a related channel, such as 'bank_command_deg' for 'bank_deg'."""
    stem, _, ending = signal.name.rpartition("_") if signal.unit != "-" else (signal.name, "", "")
    return f"{stem}_{kind}_{ending}".rstrip("_")


def _thinned(curve: Floats, band: str, every: int) -> Floats:
    """Return every ``every``-th sample; min and max bands also cover the skipped samples."""
    extreme = {"min": np.fmin, "max": np.fmax}.get(band)
    if extreme is None or every == 1:
        return curve[::every]
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(curve, every - 1, constant_values=np.nan), 2 * every - 1
    )
    return extreme.reduce(around, axis=1)[::every]


def band_names(results: FlownCampaign) -> tuple[str, ...]:
    """Return the names of the bands in a campaign's envelopes, in the order of storage."""
    return tuple(
        next((envelope.bands for envelope in results.envelopes.values()), dict.fromkeys(BANDS))
    )


def channel_curves(results: FlownCampaign, controller: str, channel: str) -> tuple[Floats, Floats]:
    """Return time [time], s, and curves [band, time] of a channel.

    Curves are the bands, in stored order, and the nominal flight; missing values are NaN.
    """
    source, reference_name = _OFF_REFERENCE.get(channel, (channel, ""))
    is_stored = (controller, channel) in results.envelopes
    envelope = results.envelopes.get((controller, channel if is_stored else source))
    nominal_columns = results.align(controller, results.nominal.get(controller, {}))
    clock = next(
        (
            envelope_of.time
            for (name, _), envelope_of in results.envelopes.items()
            if name == controller
        ),
        nominal_columns.get("time", np.empty(0)),
    )
    every = max(1, -(-clock.size // _MOST_TIMES))
    time = clock[::every]
    curves = dict.fromkeys(band_names(results), np.full(time.shape, np.nan))
    if envelope:
        reference = (
            results.reference.get(reference_name) if reference_name and not is_stored else None
        )
        ticks = results.reference.get("time", clock)
        for band, curve in bands_off(clock, envelope.bands, ticks, reference).items():
            curves[band] = _thinned(curve, band, every)
    nominal = np.full(time.shape, np.nan)
    if channel in nominal_columns:
        nominal = np.interp(time, nominal_columns["time"], nominal_columns[channel], right=np.nan)
    return time, np.stack([*curves.values(), nominal])


def envelope_data(
    results: FlownCampaign, labels: Mapping[str, str], colors: Mapping[str, str]
) -> tuple[dict[str, object], dict[str, Floats]]:
    """Return the data of the envelope view, and its arrays.

    The arrays are ``time:CONTROLLER`` [time], ``CHANNEL:CONTROLLER`` [band, time], with the nominal
    flight last, and ``reference:CHANNEL`` [time].
    """
    names = results.controllers
    recorded = {
        signal.name: signal
        for signal in results.campaign.channels
        if all((name, signal.name) in results.envelopes for name in names)
    }
    channels = []
    arrays = {}
    # Custom simulators have no reference trajectory.
    times = results.reference.get("time", np.empty(0))
    every = max(1, -(-times.size // _MOST_TIMES))
    arrays["reference:time"] = times[::every]
    for channel, signal in recorded.items():
        reference = _beside(signal, "reference")
        has_reference = reference in results.reference
        if has_reference:
            arrays[f"reference:{reference}"] = results.reference[reference][::every]
        channels.append(
            {
                **describe_channel(channel, recorded, results.campaign),
                "reference": reference if has_reference else None,
            }
        )
    for name in names:
        for channel in recorded:
            arrays[f"time:{name}"], arrays[f"{channel}:{name}"] = channel_curves(
                results, name, channel
            )
    return {
        "channels": channels,
        "controllers": [
            {"name": name, "label": labels[name], "color": colors[name]} for name in names
        ],
        "bands": [*band_names(results), "nominal"],
        "nominal": bool(results.nominal),
    }, arrays
