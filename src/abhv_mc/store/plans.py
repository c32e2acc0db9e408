"""Flight plans as .npz without pickle: nested named tuples and dataclasses as a flat set of named arrays."""

import dataclasses
import typing
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from abhv_mc.flight.plan import FlightPlan
from abhv_mc.io.input_error import InputError
from abhv_mc.store.folder import write_whole

T = TypeVar("T")
_WISH = "a plan as it was written: restore it, or run with --fresh to delete what was flown and fly it anew"
_SCALARS = (bool, int, float, str)


def flatten(value: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """Arrays and scalars of a nested record by dotted name."""
    if not _is_record(type(value)):
        return {prefix: np.asarray(value)}
    flat: dict[str, np.ndarray] = {}
    for name in _fields(type(value)):
        flat |= flatten(getattr(value, name), f"{prefix}.{name}" if prefix else name)
    return flat


def rebuild(kind: type[T], flat: dict[str, np.ndarray], prefix: str = "") -> T:
    """The record of type ``kind`` from what :func:`flatten` gave. Raises KeyError for a missing part."""
    if _is_record(kind):
        hints = typing.get_type_hints(kind)
        parts = {name: rebuild(hints[name], flat, f"{prefix}.{name}" if prefix else name) for name in _fields(kind)}
        return kind(**parts)
    value = flat[prefix]
    if kind in _SCALARS:
        return kind(value.item())  # type: ignore[call-arg]
    return value  # type: ignore[return-value]


def write_plan(path: Path, plan: FlightPlan) -> None:
    """Store a plan."""

    def write(aside: Path) -> None:
        with aside.open("wb") as file:
            np.savez_compressed(file, **flatten(plan))  # type: ignore[arg-type]

    write_whole(path, write, durable=True)


def read_plan(path: Path) -> FlightPlan:
    """A stored plan, equal to the bit. Raises InputError."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return rebuild(FlightPlan, dict(stored))
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file", _WISH) from None
    except Exception as error:  # numpy's and zipfile's on damaged files are of many kinds, SyntaxError among them
        raise InputError(path, None, None, f"a damaged plan ({error})", _WISH) from None


def _is_record(kind: Any) -> bool:
    return dataclasses.is_dataclass(kind) or (isinstance(kind, type) and hasattr(kind, "_fields"))


def _fields(kind: Any) -> tuple[str, ...]:
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind) if field.metadata.get("stored", True))
    return tuple(kind._fields)
