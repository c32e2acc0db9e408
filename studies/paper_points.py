"""The paper's Figures 3 to 11 as ranges, the verdict on a flight, and why what is not matched is not."""

from dataclasses import dataclass

import numpy as np
from experiment import Floats
from numpy.typing import NDArray

from abhv_mc.control.design.reference import SETTLING

READING = 0.02  # of a range's width
IN, AFTER, OUT = VERDICTS = ("matched", "after the steps", "not matched")
CONTROLLERS = {"tlc": "TLC", "lqr": "LQR", "lqr_retuned": "LQR retuned"}


@dataclass(frozen=True)
class Point:
    """One curve of one figure."""

    figure: str
    words: str
    channel: str
    low: float  # the paper's range, unit of the label
    high: float
    unit: str
    verdicts: tuple[str, str, str]  # those of CONTROLLERS, for which ``why`` was written
    dispersed: tuple[str, str, str]  # the same of all dispersed flights
    why: str = ""
    sign: float = 1.0  # -1: mirrored, because the paper's first bank is positive
    scale: float = 1.0

    def ours(self, values: Floats) -> Floats:
        """A channel in the paper's unit and sign."""
        return self.sign * self.scale * values


LQR_CYCLE = (
    "the paper's weights do not fit this vehicle: the fastest pole of its guidance, {guidance_pole:.1f} /s, is faster "
    "than those of the angle of attack, {attitude_pole:.1f} /s. As flown they do not stabilise it even straight and "
    "level: the closed loop's poles are +{growing:.3f} \N{PLUS-MINUS SIGN} {cycling:.2f}j per second, so angle of "
    "attack and elevator keep cycling; the retuned LQR's do not"
)
STEP = (
    "at a step of the bank command Table 1 asks for {acceleration:.0f} deg/s2 of roll at once, before its "
    "differentiators add to it. Within {limit:.1f} deg of aileron that takes {needed:.0f} deg/s2 per degree; this "
    "vehicle has {effectiveness:.0f}. The paper's command cannot have stepped as its text says, or its vehicle rolls "
    "{times:.0f} times as easily"
)
POINTS = (
    Point("3", "altitude", "altitude_m", 19.95, 20.05, "km", (IN, IN, IN), (IN, IN, IN), scale=1e-3),
    Point(
        "3",
        "speed",
        "speed_mps",
        1395.0,
        1405.0,
        "m/s",
        (IN, IN, IN),
        (IN, OUT, IN),
        "dispersed, LQR with the paper's weights goes from {speed_low:.0f} to {speed_high:.0f} m/s: the cycle of its "
        "angle of attack (Figure 5) cycles the drag",
    ),
    Point(
        "4",
        "heading",
        "heading_deg",
        84.0,
        91.0,
        "deg",
        (OUT, OUT, OUT),
        (OUT, OUT, OUT),
        "5 km in a half cosine of 50 s turn the heading by {turn:.2f} deg, to {heading:.2f}; the paper prints no "
        "formula of its S, and 84 deg belong to one of {length:.0f} s",
    ),
    Point(
        "5",
        "angle of attack",
        "angle_of_attack_deg",
        2.0,
        6.0,
        "deg",
        (IN, OUT, IN),
        (IN, OUT, IN),
        "LQR: " + LQR_CYCLE,
    ),
    Point(
        "6",
        "sideslip",
        "sideslip_deg",
        -0.2,
        0.7,
        "deg",
        (IN, AFTER, IN),
        (IN, AFTER, IN),
        "LQR: the paper's weights leave the yaw of {lqr_aileron:.0f} deg of aileron to {lqr_rudder:.1f} deg of rudder",
        sign=-1.0,
    ),
    Point(
        "7",
        "bank",
        "bank_deg",
        -55.0,
        55.0,
        "deg",
        (IN, IN, IN),
        (IN, IN, AFTER),
        "the retuned LQR passes its command at the first step, dispersed up to {retuned_bank:.1f} deg",
        sign=-1.0,
    ),
    Point(
        "8", "aileron", "aileron_deg", -1.2, 0.8, "deg", (AFTER, AFTER, AFTER), (AFTER, AFTER, AFTER), STEP, sign=-1.0
    ),
    Point(
        "9",
        "rudder",
        "rudder_deg",
        -0.4,
        0.3,
        "deg",
        (OUT, AFTER, AFTER),
        (OUT, AFTER, AFTER),
        "the rudder answers the yaw of the aileron at the steps; with TLC it is back in the range {rudder_first:.1f} s "
        "after the first and {rudder_second:.1f} s after the second",
        sign=-1.0,
    ),
    Point(
        "10",
        "elevator",
        "elevator_deg",
        -0.5,
        2.5,
        "deg",
        (OUT, OUT, OUT),
        (OUT, OUT, OUT),
        "the vehicle file puts the 1 g elevator to 0, and GHAME needs it trailing edge up, negative, for more angle of "
        "attack: down to {tlc_low:.2f} deg after the steps with TLC, {own_low:.2f} with the retuned LQR. The paper's "
        "goes the other way from 0; it prints neither its sign nor its tables. LQR: as in Figure 5",
    ),
    Point(
        "11",
        "equivalence ratio, commanded",
        "equivalence_ratio_command",
        0.8,
        1.25,
        "",
        (IN, IN, IN),
        (IN, IN, AFTER),
        "the retuned LQR answers the worst flights' first error of speed, in the second tenth of a second, with "
        "{retuned_eta:.2f}",
    ),
)


def settled(times: Floats, steps: tuple[float, ...]) -> NDArray[np.bool_]:
    """From SETTLING after each step of the reference to the next one."""
    kept = np.ones(times.size, dtype=bool)
    for step in steps:
        kept &= (times < step - 1e-9) | (times >= step + SETTLING - 1e-9)
    return kept


def judge(point: Point, times: Floats, values: Floats, steps: tuple[float, ...]) -> str:
    """The verdict on a nominal flight."""
    room = READING * (point.high - point.low)
    inside = (values >= point.low - room) & (values <= point.high + room)
    return IN if inside.all() else AFTER if inside[settled(times, steps)].all() else OUT


def spread(point: Point, low: Floats, high: Floats) -> str:
    """'a to b' in the digits of the paper's range."""
    digits = max(1, int(np.ceil(2.0 - np.log10(point.high - point.low))))
    ends = np.concatenate([point.ours(low), point.ours(high)])
    return f"{ends.min():.{digits}f} to {ends.max():.{digits}f}".replace("-", "\N{MINUS SIGN}")


def axis_of(point: Point) -> str:
    """The paper's range in words."""
    return f"{point.low:g} to {point.high:g} {point.unit}".strip().replace("-", "\N{MINUS SIGN}")
