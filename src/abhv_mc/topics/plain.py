"""Dataclasses and numpy values as JSON holds them."""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from abhv_mc.statistics.estimates import Interval

DRAWN = "drawn"  # of a field's metadata: it serves figures alone, and JSON holds none of it


def plain(value: Any) -> Any:
    """The value as JSON holds it, without what serves figures alone; infinite and missing numbers are None."""
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value) if not item.metadata.get(DRAWN)}
    if hasattr(value, "_asdict"):  # a named tuple
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def interval_in_sense(interval: Interval, sense: str) -> dict[str, Any]:
    """An interval of a severity as one of the metric itself (small values are bad in the sense "low")."""
    turned: dict[str, Any] = plain(interval.scaled(-1.0) if sense == "low" else interval)
    return turned


def interval_at(table: Any, kind: str, row: int, column: int) -> list[float | None]:
    """Value, low and high end in one place of the arrays ``kind``, ``kind_low`` and ``kind_high`` of a table."""
    ends: list[float | None] = plain([getattr(table, kind + end)[row, column] for end in ("", "_low", "_high")])
    return ends


def level_name(level: float) -> str:
    """'q95' for 0.95, 'q99.73' for 0.9973."""
    return f"q{100.0 * level:g}"
