"""The channels that a sheet shows, and what the single flight of Zhu & Shen 2014 shows of them."""

from dataclasses import dataclass

from abhv_mc.campaign.file.experiment import Experiment

_SIGN = ", sign open"


@dataclass(frozen=True)
class Curve:
    """A channel as a sheet shows it."""

    channel: str
    label: str
    reference: str = ""
    off_reference: bool = False  # what is left of it without the reference
    needles: bool = False  # whether it moves for a moment at each step of its command, which an inset shows
    paper: tuple[int, str] | None = None  # figure of the paper, and what it shows


CURVES = (
    Curve("altitude_m", "altitude error (m)", "altitude_reference_m", off_reference=True, paper=(3, "within 50 m")),
    Curve("speed_mps", "speed (m/s)", "speed_reference_mps", paper=(3, "1400 ± 5 m/s")),
    Curve("heading_deg", "heading (deg)", "heading_reference_deg", paper=(4, "84 to 91 deg")),
    Curve("angle_of_attack_deg", "angle of attack (deg)", paper=(5, "2 to 6 deg")),
    Curve("sideslip_deg", "sideslip (deg)", needles=True, paper=(6, f"−0.2 to 0.7 deg{_SIGN}")),
    Curve("bank_deg", "bank (deg)", paper=(7, "−50 to 55 deg with TLC, to 60 with LQR")),
    Curve("aileron_deg", "aileron (deg)", needles=True, paper=(8, f"−1.2 to 0.8 deg{_SIGN}")),
    Curve("rudder_deg", "rudder (deg)", needles=True, paper=(9, f"−0.4 to 0.3 deg{_SIGN}")),
    Curve("elevator_deg", "elevator (deg)", needles=True, paper=(10, f"−0.5 to 2.5 deg{_SIGN}")),
    Curve(
        "equivalence_ratio_command", "throttle (–)", "equivalence_ratio_reference", paper=(11, "0.8 to 1.25")
    ),
)  # fmt: skip


def curves_of(campaign: Experiment) -> tuple[Curve, ...]:
    """Those that a sheet of its flights may show: all channels of a user's simulator."""
    return tuple(Curve(each.name, each.axis) for each in campaign.channels) if campaign.user_model else CURVES
