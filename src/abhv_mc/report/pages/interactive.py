"""What the page's interactive envelopes show, as JSON small enough to travel inside it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.channels import CHANNELS, REFERENCE_CHANNELS
from abhv_mc.report.numbers.results import BANDS, Results

_MOST_TIMES = 301
_DIGITS = 6  # significant, of a curve's largest value


def _rounded(curve: Floats) -> list[float | None]:
    """Six digits of the curve's range and magnitude; what is not finite becomes None."""
    finite = curve[np.isfinite(curve)]
    largest = float(np.max(np.abs(finite))) if finite.size else 0.0
    decimals = _DIGITS - 1 - int(np.floor(np.log10(largest))) if largest > 0.0 else 0
    rounded = np.round(curve, decimals).tolist()
    return [value if np.isfinite(value) else None for value in rounded]


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


def envelope_data(results: Results, labels: Mapping[str, str], colors: Mapping[str, str]) -> dict[str, Any]:
    """Channels, controllers and their curves; every curve lies on its controller's `time`."""
    names = results.controllers
    held = [s for s in CHANNELS if all((name, s.name) in results.envelopes for name in names)]
    references = {signal.name for signal in REFERENCE_CHANNELS}
    channels = []
    for signal in held:
        stem, _, ending = signal.name.rpartition("_") if signal.unit != "-" else (signal.name, "", "")
        reference, command = (f"{stem}_{kind}_{ending}".rstrip("_") for kind in ("reference", "command"))
        channels.append(
            {
                "name": signal.name,
                "label": _label(signal.name, signal.unit),
                "unit": "" if signal.unit == "-" else signal.unit,
                "doc": signal.doc,
                "reference": reference if reference in references else None,
                "command": command if any(s.name == command for s in held) else None,
            }
        )
    data: dict[str, Any] = {"channels": channels, "controllers": [], "reference": _reference(results, channels)}
    for name in names:
        curves: dict[str, Any] = {}
        time: Floats = np.empty(0)
        for signal in held:
            envelope = results.envelopes[name, signal.name]
            every = max(1, -(-envelope.time.size // _MOST_TIMES))
            time = envelope.time[::every]
            curves[signal.name] = {band: _rounded(_thinned(envelope.bands[band], band, every)) for band in BANDS}
            flown = results.nominal.get(name)
            if flown is not None and signal.name in flown:
                nominal = np.interp(time, flown["time"], flown[signal.name], right=np.nan)
                curves[signal.name]["nominal"] = _rounded(nominal)
        data["controllers"].append(
            {"name": name, "label": labels[name], "color": colors[name], "time": _rounded(time), "curves": curves}
        )
    return data


def _reference(results: Results, channels: list[dict[str, Any]]) -> dict[str, Any]:
    held = results.reference
    every = max(1, -(-held["time"].size // _MOST_TIMES))
    names = ["time", *(channel["reference"] for channel in channels if channel["reference"] in held)]
    return {name: _rounded(held[name][::every]) for name in names}
