"""Conversion of dataclasses and numpy values to JSON data."""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

DRAWN = "drawn"  # metadata key of fields that are used only for figures and omitted from JSON


def json_data(value: Any) -> Any:
    """Return a value as JSON data; infinite and missing numbers become None.

    Fields marked ``DRAWN`` are omitted.
    """
    if value is None or isinstance(value, str | int):
        return value
    if type(value) is float:
        return value if math.isfinite(value) else None
    if is_dataclass(value) and not isinstance(value, type):
        return {
            item.name: json_data(getattr(value, item.name))
            for item in fields(value)
            if not item.metadata.get(DRAWN)
        }
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
