"""What stands behind flights over time: the bands and the nominal flight of a channel, and the page's view of them."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.channels import CHANNELS, REFERENCE_CHANNELS, Signal
from abhv_mc.folder.flown_campaign import BANDS, FlownCampaign
from abhv_mc.topics.figure_bands import bands_off

_MOST_TIMES = 301
_SIGNALS: dict[str, Signal] = {signal.name: signal for signal in CHANNELS}
_REFERENCES = {signal.name for signal in REFERENCE_CHANNELS}
# Errors that are a channel less the mission's reference, the same for every flight: their bands follow.
_OFF_REFERENCE = {
    "altitude_error_m": ("altitude_m", "altitude_reference_m"),
    "speed_error_mps": ("speed_mps", "speed_reference_mps"),
}


def describe_channel(
    name: str, held: Collection[str], known: Sequence[Signal] = CHANNELS
) -> dict[str, str | None]:
    """Label, unit and meaning of a channel of ``known``, and which of those ``held`` is its command."""
    signal = next((each for each in known if each.name == name), Signal(name, "-", ""))
    command = _beside(signal, "command")
    return {
        "name": name,
        "label": _label(signal),
        "unit": "" if signal.unit == "-" else signal.unit,
        "doc": signal.doc,
        "command": command if command in held else None,
    }


def _beside(signal: Signal, kind: str) -> str:
    """'bank_command_deg' of 'bank_deg'."""
    stem, _, ending = signal.name.rpartition("_") if signal.unit != "-" else (signal.name, "", "")
    return f"{stem}_{kind}_{ending}".rstrip("_")


def _label(signal: Signal) -> str:
    """'Angle of attack command' of 'angle_of_attack_command_deg'."""
    words = (
        signal.name.rpartition("_")[0]
        if signal.unit != "-" and signal.name in _SIGNALS
        else signal.name
    )
    words = words.replace("_", " ")
    return words[:1].upper() + words[1:]


def _thinned(curve: Floats, band: str, every: int) -> Floats:
    """Every so many samples; of the ends those of all samples in between too, so that no flight leaves them."""
    extreme = {"min": np.fmin, "max": np.fmax}.get(band)
    if extreme is None or every == 1:
        return curve[::every]
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(curve, every - 1, constant_values=np.nan), 2 * every - 1
    )
    return np.asarray(extreme.reduce(around, axis=1)[::every], dtype=np.float64)


def band_names(results: FlownCampaign) -> tuple[str, ...]:
    """The bands of a campaign's envelopes, in their order."""
    return tuple(
        next((envelope.bands for envelope in results.envelopes.values()), dict.fromkeys(BANDS))
    )


def channel_curves(results: FlownCampaign, controller: str, channel: str) -> tuple[Floats, Floats]:
    """Time [time] s and what stands behind a controller's flights [band, time]: the bands in their order, then the
    nominal flight; not-a-number where nothing is kept."""
    of, less = _OFF_REFERENCE.get(channel, (channel, ""))
    own = (controller, channel) in results.envelopes
    envelope = results.envelopes.get((controller, channel if own else of))
    flown = results.nominal.get(controller, {})
    clocks = [each.time for (name, _), each in results.envelopes.items() if name == controller]
    clock = next(iter(clocks), flown.get("time", np.empty(0)))
    every = max(1, -(-clock.size // _MOST_TIMES))
    time = clock[::every]
    curves = dict.fromkeys(band_names(results), np.full(time.shape, np.nan))
    if envelope:
        reference = results.reference.get(less) if less and not own else None
        ticks = results.reference.get("time", clock)
        for band, curve in bands_off(clock, envelope.bands, ticks, reference).items():
            curves[band] = _thinned(curve, band, every)
    nominal = np.full(time.shape, np.nan)
    if channel in flown:
        nominal = np.interp(time, flown["time"], flown[channel], right=np.nan)
    return time, np.stack([*curves.values(), nominal])


def envelope_data(
    results: FlownCampaign, labels: Mapping[str, str], colors: Mapping[str, str]
) -> tuple[dict[str, object], dict[str, Floats]]:
    """Channels and controllers; and arrays: ``time:CONTROLLER`` and ``CHANNEL:CONTROLLER`` [band, time], the bands in
    their order and the nominal flight behind them, and ``reference:CHANNEL``, each [time]."""
    names = results.controllers
    known = results.campaign.channels
    held = {
        each.name: each
        for each in known
        if all((name, each.name) in results.envelopes for name in names)
    }
    channels: list[dict[str, str | None]] = []
    arrays: dict[str, Floats] = {}
    times = results.reference.get("time", np.empty(0))  # a user's simulator has none
    every = max(1, -(-times.size // _MOST_TIMES))
    arrays["reference:time"] = times[::every]
    for channel, signal in held.items():
        reference = _beside(signal, "reference")
        given = reference in _REFERENCES and reference in results.reference
        if given:
            arrays[f"reference:{reference}"] = results.reference[reference][::every]
        channels.append(
            {**describe_channel(channel, held, known), "reference": reference if given else None}
        )
    for name in names:
        for channel in held:
            arrays[f"time:{name}"], arrays[f"{channel}:{name}"] = channel_curves(
                results, name, channel
            )
    controllers = [{"name": name, "label": labels[name], "color": colors[name]} for name in names]
    bands = [*band_names(results), "nominal"]
    return {
        "channels": channels,
        "controllers": controllers,
        "bands": bands,
        "nominal": bool(results.nominal),
    }, arrays
