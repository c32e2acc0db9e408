"""Conversion of flight plans, which are nested records, to and from named arrays.

Index arrays are not stored but rebuilt from the inputs, because compiled code does not check index
bounds. Only arrays of floating-point numbers with the expected shapes are read.
"""

import dataclasses
import typing
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

REBUILT = "effectiveness."  # prefix of the names of arrays that are computed from the vehicle


def flatten(value: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """Return the arrays and scalars of a nested record as a dictionary of dotted names."""
    if not _is_record(type(value)):
        return {prefix: np.asarray(value)}
    flat: dict[str, np.ndarray] = {}
    for name in _fields(type(value)):
        flat |= flatten(getattr(value, name), f"{prefix}.{name}" if prefix else name)
    return flat


def rebuild(kind: Any, flat: Mapping[str, np.ndarray], prefix: str = "") -> Any:
    """Rebuild a record of type ``kind`` from the result of :func:`flatten`.

    The arrays in the result are contiguous. Raise KeyError if an item is missing, and ValueError if
    an item has the wrong type.
    """
    if _is_record(kind):
        hints = typing.get_type_hints(kind)
        fields = {
            name: rebuild(hints[name], flat, f"{prefix}.{name}" if prefix else name)
            for name in _fields(kind)
        }
        return kind(**fields)
    value = flat[prefix]
    if kind in (bool, int, float, str):
        return kind(value.item())
    if typing.get_origin(kind) is tuple:  # tuple of floats
        return tuple(value.tolist())
    expected = find_dtype(kind)
    return np.require(value, None if expected.kind == "U" else expected, ["C", "A"])


def stored_arrays(plan: Any) -> dict[str, np.ndarray]:
    """Return the arrays of a plan that are stored; integer and derived arrays are not."""
    return {
        name: value
        for name, value in flatten(plan).items()
        if (value.ndim == 0 or value.dtype.kind in "fU") and not name.startswith(REBUILT)
    }


@cache
def find_dtype(kind: Any) -> np.dtype[Any]:
    """Return the element type of an array annotation."""
    last = typing.get_args(kind)[-1]  # the scalar, or its dtype[scalar] before numpy 2.5
    return np.dtype(next(iter(typing.get_args(last)), last))


def _is_record(kind: Any) -> bool:
    return dataclasses.is_dataclass(kind) or (isinstance(kind, type) and hasattr(kind, "_fields"))


def _fields(kind: Any) -> tuple[str, ...]:
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind) if is_stored(field))
    return tuple(kind._fields)


def is_stored(field: "dataclasses.Field[Any]") -> bool:
    """Return whether a field is stored in plan files."""
    return bool(field.metadata.get("stored", True))
