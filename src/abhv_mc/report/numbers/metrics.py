"""How a report speaks of each metric: its words, its group, and the sense in which it is bad."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from abhv_mc.flight.metrics import MARGIN_NAMES, MARGIN_VALUES, METRICS
from abhv_mc.shipped import shipped_files
from abhv_mc.statistics.estimates import Sense

_UNITS_BY_SUFFIX = {
    "_j_m2": "J/m2", "_w_m2": "W/m2", "_mps": "m/s", "_deg": "deg", "_dps": "deg/s", "_kg": "kg", "_pa": "Pa",
    "_n": "N", "_j": "J", "_g": "g", "_m": "m", "_s": "s",
    "_db": "dB", "_ms": "ms",
}  # fmt: skip
_UNIT_SUFFIXES = tuple(_UNITS_BY_SUFFIX)
_LOW = ("angle_of_attack_min_deg", "equivalence_ratio_min", *MARGIN_NAMES)
_SIGNED = ("cross_track_error_final_m",)
_TRACKING = ("altitude", "speed", "heading", "cross_track", "angle_of_attack_error", "bank_error", "sideslip")
_USAGE = ("aileron", "elevator", "rudder", "equivalence_ratio", "fuel", "surface")

# What the paper claims, in its order: both controllers hold altitude and speed (Fig. 3) ...
HOLDING = ("altitude_error_max_m", "speed_error_max_mps")
# ... with nearly the same control usage (Figs. 8-11) ...
USAGE = ("aileron_rms_deg", "rudder_rms_deg", "elevator_rms_deg")
# ... and TLC follows the commands better (Figs. 5-7).
FOLLOWING = ("angle_of_attack_error_rms_deg", "sideslip_rms_deg", "bank_error_rms_deg")
HEADLINE = (*FOLLOWING, *HOLDING)

# Channels, axes and scales of a figure of single flights.
FLIGHT_PANELS = (
    ("altitude_m", "altitude (km)", 1e-3),
    ("speed_mps", "speed (m/s)", 1.0),
    ("angle_of_attack_deg", "angle of attack (deg)", 1.0),
    ("sideslip_deg", "sideslip (deg)", 1.0),
    ("bank_deg", "bank (deg)", 1.0),
    ("elevator_deg", "elevator (deg)", 1.0),
    ("aileron_deg", "aileron (deg)", 1.0),
    ("rudder_deg", "rudder (deg)", 1.0),
)


@dataclass(frozen=True)
class MetricWords:
    """One metric as a reader sees it."""

    name: str
    label: str  # words without the unit
    unit: str  # "" where it has none
    doc: str
    group: str  # "tracking", "usage", "loads" or "stability"
    sense: Sense

    @property
    def label_with_unit(self) -> str:
        """For axes and table heads."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


def _label(name: str) -> str:
    name = name.removesuffix(next(filter(name.endswith, _UNIT_SUFFIXES), ""))
    words = name.replace("cross_track", "cross-track").replace("_", " ").replace("error final", "error at the end")
    words = re.sub(r" (settled )?(rms|max|min)$", lambda found: f", {'settled, ' if found[1] else ''}{found[2]}", words)
    return words[0].upper() + words[1:]


def _group(name: str) -> str:
    if name in MARGIN_NAMES:
        return "stability"
    if name.startswith(_TRACKING):
        return "tracking"
    return "usage" if name.startswith(_USAGE) else "loads"


def _describe(name: str, unit: str = "-", doc: str = "") -> MetricWords:
    sense: Sense = "low" if name in _LOW else "size" if name in _SIGNED else "high"
    return MetricWords(name, _label(name), "" if unit == "-" else unit, doc, _group(name), sense)


_METRIC_WORDS = {signal.name: _describe(signal.name, signal.unit, signal.doc) for signal in (*METRICS, *MARGIN_VALUES)}


def words_of(name: str) -> MetricWords:
    """The words for a metric; for one that a campaign declared, what its name says."""
    suffix = next(filter(name.endswith, _UNIT_SUFFIXES), "")
    return _METRIC_WORDS.get(name) or _describe(name, _UNITS_BY_SUFFIX.get(suffix, "-"))


_KNOWN_NAMES = {
    "tlc": "TLC",
    "lqr": "LQR",
    "lqr_retuned": "LQR retuned",
    "lqr_robust": "LQR robust",
    "tlc_robust": "TLC robust",
}


def controller_label(name: str) -> str:
    """A controller's name as it is printed."""
    return _KNOWN_NAMES.get(name, name.replace("_", " "))


def full_labels(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Labels of a campaign's controllers that say which of them is the paper's LQR, as it is not the best one."""
    paper = shipped_files("control")["lqr"].read_bytes()
    flown = {name: folder / "inputs" / "controllers" / name / "lqr.yaml" for name in names}
    return {
        name: controller_label(name) + (" (paper's weights)" if path.is_file() and path.read_bytes() == paper else "")
        for name, path in flown.items()
    }
