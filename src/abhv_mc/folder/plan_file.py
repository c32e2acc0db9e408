"""Flight plans as .npz without pickle: the numbers of nested named tuples and dataclasses as named arrays.

Compiled code follows a plan's index arrays without a look at their bounds. So no file holds them: they are rebuilt from
the campaign's inputs, and what is read are floating-point numbers, of the shapes that belong to them.
"""

import dataclasses
import io
import typing
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from abhv_mc.flight.plan import FlightPlan
from abhv_mc.folder.layout import write_bytes
from abhv_mc.io.input_error import InputError

T = TypeVar("T")
WISH = (
    "a copy of the plan as it was, or the campaign flown anew: another folder (-o DIR), or --fresh"
)
REBUILT = "effectiveness."  # follows from the vehicle


def flatten(value: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """Arrays and scalars of a nested record by dotted name."""
    if not _is_record(type(value)):
        return {prefix: np.asarray(value)}
    flat: dict[str, np.ndarray] = {}
    for name in _fields(type(value)):
        flat |= flatten(getattr(value, name), f"{prefix}.{name}" if prefix else name)
    return flat


def rebuild(kind: Any, flat: Mapping[str, np.ndarray], prefix: str = "") -> Any:
    """The record of type ``kind`` from what :func:`flatten` gave, with contiguous arrays.

    Raises KeyError for a missing part and ValueError for one that is no such number or array.
    """
    if _is_record(kind):
        hints = typing.get_type_hints(kind)
        parts = {
            name: rebuild(hints[name], flat, f"{prefix}.{name}" if prefix else name)
            for name in _fields(kind)
        }
        return kind(**parts)
    value = flat[prefix]
    if kind in (bool, int, float, str):
        return kind(value.item())
    if typing.get_origin(kind) is tuple:  # of floats
        return tuple(value.tolist())
    expected = np.dtype(typing.get_args(typing.get_args(kind)[1])[0])
    return np.require(value, None if expected.kind == "U" else expected, ["C", "A"])


def write_plan(path: Path, plan: Any) -> None:
    """Store a plan's numbers and words."""
    content = io.BytesIO()
    with zipfile.ZipFile(
        content, "w", zipfile.ZIP_DEFLATED, compresslevel=1
    ) as archive:  # numpy's own takes thrice that
        for name, value in stored_parts(plan).items():
            with archive.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, value, allow_pickle=False)
    write_bytes(path, content.getvalue(), durable=True)


def stored_parts(plan: FlightPlan) -> dict[str, np.ndarray]:
    """What of a plan is stored: no array of whole numbers, and nothing that follows from the rest."""
    numbers = {
        name: value
        for name, value in flatten(plan).items()
        if value.ndim == 0 or value.dtype.kind in "fU"
    }
    return {name: value for name, value in numbers.items() if not name.startswith(REBUILT)}


def read_stored_parts(path: Path) -> dict[str, np.ndarray]:
    """What :func:`stored_parts` gave. Raises InputError."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return dict(stored)
    except FileNotFoundError:
        raise InputError(path, "no such file", WISH) from None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(path, f"a damaged plan ({error})", WISH) from None


def _is_record(kind: Any) -> bool:
    return dataclasses.is_dataclass(kind) or (isinstance(kind, type) and hasattr(kind, "_fields"))


def _fields(kind: Any) -> tuple[str, ...]:
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind) if is_stored(field))
    return tuple(kind._fields)


def is_stored(field: "dataclasses.Field[Any]") -> bool:
    """Return whether files of plans hold a field."""
    return bool(field.metadata.get("stored", True))
