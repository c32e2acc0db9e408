"""How a report names controllers and the channels of single flights."""

from collections.abc import Iterable
from pathlib import Path

from abhv_mc.shipped import shipped_files

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
