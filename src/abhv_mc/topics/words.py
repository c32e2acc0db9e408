"""Numbers as text, to the digits that their Monte Carlo error allows; dispersed parameters and their values."""

import math
from collections.abc import Sequence

from abhv_mc.plant.parameters import OURS, Parameters
from abhv_mc.statistics.estimates import Interval

MINUS = "\N{MINUS SIGN}"
THIN = "\N{NARROW NO-BREAK SPACE}"


def _decimals(error: float) -> int:
    """Decimal places that show the first digit of an error, two digits where it begins with 1."""
    magnitude = math.floor(math.log10(error))
    return -magnitude + (1 if error / 10.0**magnitude < 2.0 else 0)


def fixed(value: float, decimals: int) -> str:
    """A number with a true minus sign; negative `decimals` round before the point."""
    text = f"{round(value, decimals):,.{max(decimals, 0)}f}".replace(",", THIN)
    return (
        text.replace("-", MINUS) if float(round(value, decimals)) != 0.0 else text.replace("-", "")
    )


def significant(value: float | None, digits: int = 3) -> str:
    """A number to so many significant digits; an em dash where there is none."""
    if value is None or not math.isfinite(value):
        return "\N{EM DASH}"
    if value == 0.0:
        return "0"
    return fixed(value, digits - 1 - math.floor(math.log10(abs(value))))


def ends_of(interval: Interval) -> tuple[float | None, float | None, float | None]:
    """Value, low and high end; None for what is missing or open."""
    ends = interval.value, interval.low, interval.high
    value, low, high = (end if math.isfinite(end) else None for end in ends)
    return value, low, high


def _places(interval: Interval) -> int | None:
    """Decimal places for an interval: the first digit of half its width (from one side where the other is open), within
    one and four digits of its largest number."""
    value, *bounds_of = ends_of(interval)
    ends = [end for end in bounds_of if end is not None]
    if value is None or not ends:
        return None
    error = (
        abs(ends[1] - ends[0]) / 2.0 if len(ends) == 2 else abs(ends[0] - value)
    )  # by rounding, ends may cross
    if not error:
        return None
    largest = max(map(abs, (value, *ends)))
    leading = -math.floor(math.log10(largest)) if largest else 0
    places = min(max(_decimals(error), leading), leading + 3)
    # An end that is not zero should not read as zero.
    return places + any(end and round(end, places) == 0.0 for end in ends)


def estimate(interval: Interval) -> str:
    """The value of an interval to the digits its width allows, four at most."""
    places = _places(interval)
    value = ends_of(interval)[0]
    return significant(value) if places is None or value is None else fixed(value, places)


def bounds(interval: Interval) -> str:
    """The ends of an interval, to the digits of its value; says where an end is open."""
    places, (value, low, high) = _places(interval), ends_of(interval)
    if value is None or (low is None and high is None):
        return ""

    def text(end: float) -> str:
        return significant(end) if places is None else fixed(end, places)

    if low is None or high is None:
        return f"at most {text(high)}" if high is not None else f"at least {text(low or 0.0)}"
    return f"{text(low)} to {text(high)}"


def percent(share: float | None, digits: int = 3) -> str:
    """A share as a percentage; near 0 and 100 % the distance from there has `digits` significant digits."""
    if share is None:
        return "\N{EM DASH}"
    rest = 100.0 * min(abs(share), abs(1.0 - share))
    if 0.0 < rest < 1e-4:
        return f"< 0.0001{THIN}%" if share < 0.5 else f"> 99.9999{THIN}%"
    places = 0 if rest == 0.0 else min(max(0, digits - 1 - math.floor(math.log10(rest))), 6)
    text = fixed(100.0 * share, places)
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text}{THIN}%"


def count_of(count: int, total: int, noun: str = "") -> str:
    """'3 of 1000 flights', numbers grouped."""
    words = f"{count:,} of {total:,}".replace(",", THIN)
    return f"{words} {noun}".rstrip()


def p_value(value: float) -> str:
    """A p-value as it is printed: never 0."""
    return "< 0.0001" if value < 1e-4 else significant(value, 2)


def joined(words: Sequence[str]) -> str:
    """'a', 'a and b', 'a, b and c'."""
    return (
        words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""
    )


_UNSPOKEN = ("aero", "atmosphere", "control", "mass", "propulsion")  # groups that go without saying
_FAILURE_KINDS = {
    "stuck_time": "sticking time",
    "loss_time": "loss time",
    "slow_time": "slowing time",
}
_SENSOR_ERRORS = ("_bias", "_noise", "_scale", "_lag", "_interval")
_SHOWN = {"rad": ("deg", 180.0 / math.pi), "rad/s": ("deg/s", 180.0 / math.pi)}


def is_factor(name: str, known: Parameters = OURS) -> bool:
    """Whether a parameter multiplies (1 = nominal) rather than adds."""
    return name not in known or known[name].is_factor


def shown_value(name: str, value: float | None, known: Parameters = OURS) -> str:
    """'+8.1 %' of a factor of 1.081, '0.3 deg' of radians, 'never' of a failure that does not come (inf or None)."""
    if value is None or not math.isfinite(value):
        return (
            "never"
            if name.endswith("time")
            else "where it is"
            if name.endswith("stuck_at")
            else "for good"
        )
    if is_factor(name, known):
        change = fixed(100.0 * (value - 1.0), 1)
        return f"{'+' if value > 1.0 and change != '0.0' else ''}{change}\N{NO-BREAK SPACE}%"
    unit, scale = axis_unit(name, known)
    return f"{significant(value * scale)}\N{NO-BREAK SPACE}{unit}".rstrip("\N{NO-BREAK SPACE}")


def axis_unit(name: str, known: Parameters = OURS) -> tuple[str, float]:
    """The unit of an axis of this parameter, and what multiplies its values: ('factor', 1) or ('deg', 57.3)."""
    if is_factor(name, known):
        return "factor", 1.0
    unit = known[name].unit
    word, scale = (unit, 1.0) if known[name].of_user else _SHOWN.get(unit, (unit, 1.0))
    return "" if word == "-" else word, scale


def spoken_name(name: str) -> str:
    """'lift' for 'aero.lift', 'wind north' for 'wind.north', 'yawing moment due to sideslip' for that part of it."""
    group, _, rest = name.partition(".")
    if not rest:
        return name.replace("_", " ")
    if name == "mass.total":
        return "mass"
    if group == "failure":
        what, _, kind = rest.rpartition(".")
        what = f"{what.removeprefix('sensor.')} sensor" if what.startswith("sensor.") else what
        name = f"{what} {_FAILURE_KINDS.get(kind, f'failure {kind}')}"
    unspoken = group in _UNSPOKEN or (group == "sensor" and name.endswith(_SENSOR_ERRORS))
    words = rest if unspoken else name
    if group == "aero" and not words.endswith(".increment"):
        words = words.replace(".", " due to ")
    return words.replace("center_of", "centre_of").replace(".", " ").replace("_", " ")


def parameter_doc(name: str, known: Parameters = OURS) -> str:
    """What it is, in words."""
    return known[name].doc if name in known else ""
