"""Dataclasses and numpy values as JSON holds them."""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

DRAWN = "drawn"  # of a field's metadata: it serves figures alone, and JSON holds none of it


def plain(value: Any) -> Any:
    """The value as JSON holds it, without what serves figures alone; infinite and missing numbers are None."""
    if is_dataclass(value) and not isinstance(value, type):
        return {
            item.name: plain(getattr(value, item.name))
            for item in fields(value)
            if not item.metadata.get(DRAWN)
        }
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


def level_name(level: float) -> str:
    """'q95' for 0.95, 'q99.73' for 0.9973."""
    return f"q{100.0 * level:g}"
