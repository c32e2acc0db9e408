"""Flight plans as .npz without pickle: nested named tuples and dataclasses as a flat set of named arrays."""

import dataclasses
import io
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from abhv_mc.flight.plan import FlightPlan
from abhv_mc.folder.layout import write_bytes
from abhv_mc.folder.packed import open_packed
from abhv_mc.folder.plan_check import find_fault
from abhv_mc.io.input_error import InputError

T = TypeVar("T")
_WISH = "a plan as it was written: restore it, or run with --fresh to delete what was flown and fly it anew"
_KINDS = {bool: "b", int: "i", float: "f", str: "U"}  # numpy's kind of each scalar
_BOUNDS = (
    "limits.",
    "vehicle.constants.inlet.",
    "vehicle.constants.bounds.",
)  # may be infinite


def flatten(value: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """Arrays and scalars of a nested record by dotted name."""
    if not _is_record(type(value)):
        return {prefix: np.asarray(value)}
    flat: dict[str, np.ndarray] = {}
    for name in _fields(type(value)):
        flat |= flatten(getattr(value, name), f"{prefix}.{name}" if prefix else name)
    return flat


def rebuild(kind: type[T], flat: Mapping[str, np.ndarray], prefix: str = "") -> T:
    """The record of type ``kind`` from what :func:`flatten` gave, with contiguous arrays and finite numbers.

    Bounds alone may be infinite. Raises KeyError for a missing part and ValueError for one of another type.
    """
    if _is_record(kind):
        hints = typing.get_type_hints(kind)
        parts = {name: rebuild(hints[name], flat, f"{prefix}.{name}" if prefix else name) for name in _fields(kind)}
        return kind(**parts)
    value = flat[prefix]
    if kind in _KINDS:
        if value.dtype.kind != _KINDS[kind] or value.ndim or (kind is float and not _is_number(value, prefix)):
            raise ValueError(f"{prefix}: {value.dtype} {value.shape} instead of one finite {kind.__name__}")
        return kind(value.item())  # type: ignore[call-arg]
    if typing.get_origin(kind) is tuple:  # of floats
        count = len(typing.get_args(kind))
        if value.dtype != np.float64 or value.shape != (count,) or not _is_number(value, prefix):
            raise ValueError(f"{prefix}: {value.dtype} {value.shape} instead of {count} finite floats")
        return tuple(value.tolist())  # type: ignore[return-value]
    wanted = np.dtype(typing.get_args(typing.get_args(kind)[1])[0])
    if value.dtype != wanted and not (wanted.kind == "U" == value.dtype.kind):
        raise ValueError(f"{prefix}: {value.dtype} instead of {wanted}")
    if wanted.kind == "f" and not _is_number(value, prefix):
        raise ValueError(f"{prefix}: a number that is not finite")
    return np.require(value, requirements=["C", "A"])  # type: ignore[return-value]


def _is_number(value: np.ndarray, name: str) -> bool:
    bound = name.removeprefix("steady.").startswith(_BOUNDS)  # the plan of steady flight within one with margins
    return not np.isnan(value).any() if bound else bool(np.isfinite(value).all())


def write_plan(path: Path, plan: FlightPlan) -> None:
    """Store a plan."""

    write_bytes(path, pack_plan(plan), durable=True)


def pack_plan(plan: FlightPlan) -> bytes:
    """A plan as the content of its file; equal plans have equal content."""
    content = io.BytesIO()
    np.savez_compressed(content, **flatten(plan))  # type: ignore[arg-type]
    return content.getvalue()


def read_plan(path: Path) -> FlightPlan:
    """A stored plan, equal to the bit. Raises InputError."""
    try:
        with open_packed(path) as stored:
            plan = rebuild(FlightPlan, stored)
            fault = find_fault(plan)
            if fault is not None:
                raise ValueError(fault)
            return plan
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file", _WISH) from None
    except Exception as error:  # those of numpy and zipfile on damaged files are of many kinds, SyntaxError among them
        raise InputError(path, None, None, f"a damaged plan ({error})", _WISH) from None


def _is_record(kind: Any) -> bool:
    return dataclasses.is_dataclass(kind) or (isinstance(kind, type) and hasattr(kind, "_fields"))


def _fields(kind: Any) -> tuple[str, ...]:
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind) if field.metadata.get("stored", True))
    return tuple(kind._fields)
