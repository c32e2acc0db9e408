"""What a flight observes, as numbers that the compiled code reads: limits and recorded channels."""

import math
from functools import cache
from typing import Any

import numpy as np

from abhv_mc.flight.channels import Channel
from abhv_mc.flight.outcome import LIMITS, Limits
from abhv_mc.kernel.flight.derived import DERIVED
from abhv_mc.kernel.flight.interface import Observed
from abhv_mc.kernel.flight.observe import find_row

_DEG = 180.0 / math.pi
_FLOWN = 0.5  # verdict of a flight that has met its mission's end: below every limit's code, and OK as a whole number


def find_place(source: str) -> int:
    """Row of the lane memory where a source stands; ``effector_at+3`` is the fourth of its rows."""
    name, _, place = source.partition("+")
    return find_row(name) + int(place or 0)


def find_factor(source: str, unit: str) -> float:
    """What turns the row of a source into a unit: rows are in SI and radians, derived quantities in their own unit."""
    return _DEG if unit in ("deg", "deg/s") and source not in DERIVED and not source.endswith("_deg") else 1.0


def make_observed(limits: Limits, recorded: tuple[Channel, ...]) -> Observed:
    """The tables for one plan's limits and the ``recorded`` channels."""
    bounded = [limit for limit in LIMITS if any(map(math.isfinite, limit.bounds(limits)))]  # perhaps none
    bounds = np.array([limit.bounds(limits) for limit in bounded], np.float64).reshape(-1, 2)
    return Observed(
        np.array([find_row(limit.source) for limit in bounded], np.int64),
        np.array([float(limit.outcome) or _FLOWN for limit in bounded], np.float64),
        bounds[:, 0].copy(),
        bounds[:, 1].copy(),
        *_channel_tables(recorded),
    )


@cache
def _channel_tables(recorded: tuple[Channel, ...]) -> tuple[Any, ...]:
    return (
        np.array([find_place(channel.source) for channel in recorded], np.int64),
        np.array([find_factor(channel.source, channel.unit) for channel in recorded], np.float64),
    )
