"""Formatting of numbers to the precision of Monte Carlo estimates, of parameters, and as JSON."""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from abhv_mc.flights.parameters import Parameters
from abhv_mc.io.messages import THIN, grouped_digits
from abhv_mc.statistics.estimates import Interval

MINUS = "\N{MINUS SIGN}"


def fixed(value: float, decimals: int) -> str:
    """Format a number with a true minus sign; `decimals` of -1 rounds to tens."""
    text = grouped_digits(round(value, decimals), max(decimals, 0))
    return text.replace("-", MINUS if round(value, decimals) else "")


def significant(value: float | None, digits: int = 3) -> str:
    """Format a number to ``digits`` significant digits, or None as an em dash."""
    if value is None or not math.isfinite(value):
        return "\N{EM DASH}"
    if value == 0.0:
        return "0"
    return fixed(value, digits - 1 - math.floor(math.log10(abs(value))))


def ends_of(interval: Interval) -> tuple[float | None, float | None, float | None]:
    """Return an interval's value, lower bound and upper bound; None if missing or infinite."""
    ends = interval.value, interval.low, interval.high
    value, low, high = (end if math.isfinite(end) else None for end in ends)
    return value, low, high


def _places(interval: Interval) -> int | None:
    """Return the number of decimals for printing an interval, from half its width.

    If one bound is infinite, the distance of the other bound from the value is used. The largest
    number gets one to four significant digits.
    """
    value, *bounds_of = ends_of(interval)
    ends = [end for end in bounds_of if end is not None]
    if value is None or not ends:
        return None
    # Due to rounding, the bounds may be in reverse order.
    error = abs(ends[1] - ends[0]) / 2.0 if len(ends) == 2 else abs(ends[0] - value)
    if not error:
        return None
    largest = max(map(abs, (value, *ends)))
    leading = -math.floor(math.log10(largest)) if largest else 0
    # one digit of the error, or two if the first is a 1
    magnitude = math.floor(math.log10(error))
    own = -magnitude + (error / 10.0**magnitude < 2.0)
    decimals = min(max(own, leading), leading + 3)
    # A nonzero bound should not be printed as zero.
    return decimals + any(end and round(end, decimals) == 0.0 for end in ends)


def estimate(interval: Interval) -> str:
    """Format an interval's value with the digits that the width justifies, at most four."""
    decimals = _places(interval)
    value = ends_of(interval)[0]
    return significant(value) if decimals is None or value is None else fixed(value, decimals)


def bounds(interval: Interval) -> str:
    """Format both bounds of an interval with its value's decimals, or as 'at most 3.2'."""
    decimals, (value, low, high) = _places(interval), ends_of(interval)
    if value is None or (low is None and high is None):
        return ""

    def text(end: float) -> str:
        return significant(end) if decimals is None else fixed(end, decimals)

    if low is None or high is None:
        return f"at most {text(high)}" if high is not None else f"at least {text(low or 0.0)}"
    return f"{text(low)} to {text(high)}"


def percent(share: float | None, digits: int = 3) -> str:
    """Format a share as a percentage.

    The distance from the nearer of 0 and 100 % is given to `digits` significant digits.
    """
    if share is None:
        return "\N{EM DASH}"
    distance = 100.0 * min(abs(share), abs(1.0 - share))
    if 0.0 < distance < 1e-4:
        return f"< 0.0001{THIN}%" if share < 0.5 else f"> 99.9999{THIN}%"
    decimals = (
        0 if distance == 0.0 else min(max(0, digits - 1 - math.floor(math.log10(distance))), 6)
    )
    text = fixed(100.0 * share, decimals)
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text}{THIN}%"


def count_of(count: int, total: int) -> str:
    """Format a count such as '3 of 1000'."""
    return f"{grouped_digits(count)} of {grouped_digits(total)}"


def p_value(value: float) -> str:
    """Format a p-value, which is never printed as 0."""
    return "< 0.0001" if value < 1e-4 else significant(value, 2)


def p_equation(value: float) -> str:
    """Format a p-value as 'p = 0.03' or 'p < 0.0001'."""
    return f"p {p_value(value)}" if value < 1e-4 else f"p = {p_value(value)}"


# prefixes of parameter names that sentences omit
_UNSPOKEN = ("aero", "atmosphere", "control", "mass", "propulsion")
_FAILURE_KINDS = {
    "stuck_time": "sticking time",
    "loss_time": "loss time",
    "slow_time": "slowing time",
}
_SENSOR_ERRORS = ("_bias", "_noise", "_scale", "_lag", "_interval")
_SHOWN = {"rad": ("deg", 180.0 / math.pi), "rad/s": ("deg/s", 180.0 / math.pi)}


def is_factor(name: str, parameters: Parameters) -> bool:
    """Return whether a parameter is a factor (1 = nominal) rather than an increment."""
    return name not in parameters or parameters[name].is_factor


def shown_value(name: str, value: float | None, parameters: Parameters) -> str:
    """Format a parameter's value: '+8.1 %' for a factor of 1.081, '0.3 deg' for radians.

    A failure that does not occur (inf or None) is shown as 'never'.
    """
    if value is None or not math.isfinite(value):
        return (
            "never"
            if name.endswith("time")
            else "where it is"
            if name.endswith("stuck_at")
            else "for good"
        )
    if is_factor(name, parameters):
        change = fixed(100.0 * (value - 1.0), 1)
        return f"{'+' if value > 1.0 and change != '0.0' else ''}{change}\N{NO-BREAK SPACE}%"
    unit, scale = axis_unit(name, parameters)
    return f"{significant(value * scale)}\N{NO-BREAK SPACE}{unit}".rstrip("\N{NO-BREAK SPACE}")


def axis_unit(name: str, parameters: Parameters) -> tuple[str, float]:
    """Return the unit of a parameter's axis and its conversion factor, e.g. ('deg', 57.3)."""
    if is_factor(name, parameters):
        return "factor", 1.0
    unit = parameters[name].unit
    word, scale = (unit, 1.0) if parameters[name].of_user else _SHOWN.get(unit, (unit, 1.0))
    return "" if word == "-" else word, scale


def spoken_name(name: str) -> str:
    """Return a parameter's name for a sentence, such as 'lift' for 'aero.lift'.

    A term of a coefficient is named, for example, 'yawing moment due to sideslip'.
    """
    group, _, suffix = name.partition(".")
    if not suffix:
        return name.replace("_", " ")
    if name == "mass.total":
        return "mass"
    if group == "failure":
        what, _, kind = suffix.rpartition(".")
        what = f"{what.removeprefix('sensor.')} sensor" if what.startswith("sensor.") else what
        name = f"{what} {_FAILURE_KINDS.get(kind, f'failure {kind}')}"
    unspoken = group in _UNSPOKEN or (group == "sensor" and name.endswith(_SENSOR_ERRORS))
    phrase = suffix if unspoken else name
    if group == "aero" and not phrase.endswith(".increment"):
        phrase = phrase.replace(".", " due to ")
    return phrase.replace("center_of", "centre_of").replace(".", " ").replace("_", " ")


def parameter_doc(name: str, parameters: Parameters) -> str:
    """Return the description of a parameter."""
    return parameters[name].doc if name in parameters else ""


def json_data(value: Any) -> Any:
    """Return a value as JSON data; infinite and missing numbers become None."""
    if value is None or isinstance(value, str | int):
        return value
    if type(value) is float:
        return value if math.isfinite(value) else None
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: json_data(getattr(value, item.name)) for item in fields(value)}
    if hasattr(value, "_asdict"):  # named tuple
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(key): json_data(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_data(item) for item in value]
    if isinstance(value, np.ndarray):
        return json_data(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def level_name(level: float) -> str:
    """Return the name of a quantile level, such as 'q95' for 0.95."""
    return f"q{100.0 * level:g}"
