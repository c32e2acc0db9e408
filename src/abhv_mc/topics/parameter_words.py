"""How a report speaks of a dispersed parameter and its values."""

import math

from abhv_mc.plant.parameters import OURS, Parameters
from abhv_mc.topics.words import fixed, significant

_UNSPOKEN = ("aero", "atmosphere", "control", "mass", "propulsion")  # groups that go without saying
_FAILURE_KINDS = {"stuck_time": "sticking time", "loss_time": "loss time", "slow_time": "slowing time"}
_SENSOR_ERRORS = ("_bias", "_noise", "_scale", "_lag", "_interval")
_SHOWN = {"rad": ("deg", 180.0 / math.pi), "rad/s": ("deg/s", 180.0 / math.pi)}


def is_factor(name: str, known: Parameters = OURS) -> bool:
    """Whether a parameter multiplies (1 = nominal) rather than adds."""
    return name not in known or known[name].is_factor


def shown_value(name: str, value: float | None, known: Parameters = OURS) -> str:
    """'+8.1 %' for a factor of 1.081, '0.3 deg' for an error in radians, 'never' for a failure that does not come.

    None is how JSON holds an infinite value.
    """
    if value is None or not math.isfinite(value):
        return "never" if name.endswith("time") else "where it is" if name.endswith("stuck_at") else "for good"
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
