"""How a report speaks of a dispersed parameter and its values."""

import math

from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.plant.parameters import PARAMETERS
from abhv_mc.topics.words import fixed, significant

_UNSPOKEN = ("aero", "atmosphere", "control", "mass", "propulsion")  # groups that go without saying
_FAILURE_KINDS = {"stuck_time": "sticking time", "loss_time": "loss time", "slow_time": "slowing time"}
_SENSOR_ERRORS = ("_bias", "_noise", "_scale", "_lag", "_interval")
_SHOWN = {"rad": ("deg", 180.0 / math.pi), "rad/s": ("deg/s", 180.0 / math.pi)}


def is_factor(name: str) -> bool:
    """Whether a parameter multiplies (1 = nominal) rather than adds."""
    return name not in PARAMETER_INDEX or PARAMETERS[PARAMETER_INDEX[name]].nominal == 1.0


def shown_value(name: str, value: float | None) -> str:
    """'+8.1 %' for a factor of 1.081, '0.3 deg' for an error in radians, 'never' for a failure that does not come.

    None is how JSON holds an infinite value.
    """
    if value is None or not math.isfinite(value):
        return "never" if name.endswith("time") else "where it is" if name.endswith("stuck_at") else "for good"
    if is_factor(name):
        change = fixed(100.0 * (value - 1.0), 1)
        return f"{'+' if value > 1.0 and change != '0.0' else ''}{change}\N{NO-BREAK SPACE}%"
    unit, scale = axis_unit(name)
    return f"{significant(value * scale)}\N{NO-BREAK SPACE}{unit}".rstrip("\N{NO-BREAK SPACE}")


def axis_unit(name: str) -> tuple[str, float]:
    """The unit of an axis of this parameter, and what multiplies its values: ('factor', 1) or ('deg', 57.3)."""
    if is_factor(name):
        return "factor", 1.0
    word, scale = _SHOWN.get(PARAMETERS[PARAMETER_INDEX[name]].unit, (PARAMETERS[PARAMETER_INDEX[name]].unit, 1.0))
    return "" if word == "-" else word, scale


def spoken_name(name: str) -> str:
    """'lift' for 'aero.lift', 'wind north' for 'wind.north', 'yawing moment due to sideslip' for that part of it."""
    group, _, rest = name.partition(".")
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


def parameter_doc(name: str) -> str:
    """What it is, in words."""
    return PARAMETERS[PARAMETER_INDEX[name]].doc if name in PARAMETER_INDEX else ""
