"""What the page's interactive envelopes show: words for the script, and the curves, which travel packed."""

from collections.abc import Mapping

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.channels import CHANNELS, REFERENCE_CHANNELS
from abhv_mc.folder.flown_campaign import BANDS, FlownCampaign

_MOST_TIMES = 301


def _thinned(curve: Floats, band: str, every: int) -> Floats:
    """Every so many samples; of the ends those of all samples in between too, so that no flight leaves them."""
    extreme = {"min": np.fmin, "max": np.fmax}.get(band)
    if extreme is None or every == 1:
        return curve[::every]
    around = np.lib.stride_tricks.sliding_window_view(np.pad(curve, every - 1, constant_values=np.nan), 2 * every - 1)
    return np.asarray(extreme.reduce(around, axis=1)[::every], dtype=np.float64)


def _label(name: str, unit: str) -> str:
    """'Angle of attack command' from 'angle_of_attack_command_deg'."""
    suffix = {"m/s": "_mps", "deg/s": "_dps", "-": ""}.get(unit, f"_{unit.lower()}")
    words = name.removesuffix(suffix).replace("_", " ")
    return words[0].upper() + words[1:]


def envelope_data(
    results: FlownCampaign, labels: Mapping[str, str], colors: Mapping[str, str]
) -> tuple[dict[str, object], dict[str, Floats]]:
    """Channels and controllers; and arrays: ``time:CONTROLLER`` and ``CHANNEL:CONTROLLER`` [band, time], the bands in
    their order and the nominal flight behind them, and ``reference:CHANNEL``, each [time]."""
    names = results.controllers
    bands = tuple(next((envelope.bands for envelope in results.envelopes.values()), dict.fromkeys(BANDS)))
    held = [s for s in CHANNELS if all((name, s.name) in results.envelopes for name in names)]
    references = {signal.name for signal in REFERENCE_CHANNELS}
    channels = []
    arrays: dict[str, Floats] = {}
    times = results.reference.get("time", np.empty(0))  # a user's simulator has none
    every = max(1, -(-times.size // _MOST_TIMES))
    arrays["reference:time"] = times[::every]
    for signal in held:
        stem, _, ending = signal.name.rpartition("_") if signal.unit != "-" else (signal.name, "", "")
        reference, command = (f"{stem}_{kind}_{ending}".rstrip("_") for kind in ("reference", "command"))
        if reference in references and reference in results.reference:
            arrays[f"reference:{reference}"] = results.reference[reference][::every]
        channels.append(
            {
                "name": signal.name,
                "label": _label(signal.name, signal.unit),
                "unit": "" if signal.unit == "-" else signal.unit,
                "doc": signal.doc,
                "reference": reference if f"reference:{reference}" in arrays else None,
                "command": command if any(s.name == command for s in held) else None,
            }
        )
    for name in names:
        for signal in held:
            envelope = results.envelopes[name, signal.name]
            every = max(1, -(-envelope.time.size // _MOST_TIMES))
            time = arrays[f"time:{name}"] = envelope.time[::every]
            curves = [_thinned(envelope.bands[band], band, every) for band in bands]
            flown = results.nominal.get(name, {})
            nominal = np.full(time.shape, np.nan)
            if signal.name in flown:
                nominal = np.interp(time, flown["time"], flown[signal.name], right=np.nan)
            arrays[f"{signal.name}:{name}"] = np.stack([*curves, nominal])
    controllers = [{"name": name, "label": labels[name], "color": colors[name]} for name in names]
    return {"channels": channels, "controllers": controllers, "bands": [*bands, "nominal"]}, arrays
