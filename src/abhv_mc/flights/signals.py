"""Signals of flights: quantities that are recorded, or that metrics evaluate."""

import math
from dataclasses import dataclass, field

from abhv_mc.io.units import parse_unit


@dataclass(frozen=True)
class Signal:
    """Quantity that describes a flight: a number or a function of time."""

    name: str  # name that ends with the unit
    unit: str
    doc: str
    circular: bool = field(default=False, kw_only=True)  # whether a full turn changes nothing

    @property
    def period(self) -> float:
        """Return a full turn in the unit of a circular quantity, else 0."""
        return 2.0 * math.pi / parse_unit(self.unit)[0] if self.circular else 0.0

    @property
    def axis(self) -> str:
        """Return the label of a plot axis, with unit."""
        return f"{self.name.replace('_', ' ')} ({self.unit})".replace("(-)", "(–)")


@dataclass(frozen=True)
class Source(Signal):
    """Quantity that expressions of metrics may use."""

    source: str  # name of the row that contains the source
    nonnegative: bool = False  # whether the quantity is never negative


class Channel(Source):
    """Source that is recorded in time histories."""
