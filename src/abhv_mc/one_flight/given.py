"""Inputs of one flight: by shipped name, path or mapping, dispersions as numbers or text with a unit.

A mapping is the file's content, or ``base`` and the entries that differ: ``{"base": "tlc", "limits.bank": "60 deg"}``.
"""

import atexit
import copy
import functools
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from abhv_mc.io.documents import (
    Document,
    InputError,
    Refusal,
    describe,
    one_of,
    read_document,
    write_document,
)
from abhv_mc.io.units import Dimension, dimension_of, parse_quantity
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from abhv_mc.flight.plan import FlightPlan
    from abhv_mc.kernel.plant.vehicle import Vehicle

Input = str | Path | Mapping[str, Any] | Callable[..., Any]
Quantity = float | str  # a number in SI (angles in rad), or text with a unit


def make_document(kind: str, given: Input) -> Document:
    """An input of a kind (``vehicle``, ``mission``, ``control``) as a document. Raises InputError."""
    if callable(given):
        return _make_law_document(kind, given)
    if not isinstance(given, Mapping):
        return read_document(find_input(given, kind))
    changes = {str(key): value for key, value in given.items()}
    base = changes.pop("base", None)
    if base is None:
        return Document(Path(f"<{kind}>"), changes, {(): (1, 1)}, {})
    document = read_document(find_input(base, kind))
    data: Any = copy.deepcopy(document.data)
    for key, value in changes.items():
        *path, last = key.split(".")
        place = data
        for i, name in enumerate(path):
            if not isinstance(place, dict) or name not in place:
                known = place if isinstance(place, dict) else ()
                found = f"no entry '{'.'.join(path[: i + 1])}'"
                raise InputError(
                    document.path, found, one_of(known, name) if known else "a mapping"
                )
            place = place[name]
        if not isinstance(place, dict):
            raise InputError(document.path, f"no entry '{key}'", "the key of a mapping")
        place[last] = value
    return Document(document.path, data, document.value_places, document.key_places)


def _make_law_document(kind: str, law: Callable[..., Any]) -> Document:
    """A law's function as a controller; its text is taken now."""
    from abhv_mc.user_code.from_function import make_law_text

    if kind != "control":
        raise InputError(kind, "a function", "a name, a path or a mapping")
    text = make_law_text(law)
    folder = _temporary_folder() / hashlib.sha256(text.encode()).hexdigest()[:16]
    folder.mkdir(exist_ok=True)
    file = folder / f"{law.__name__}.py"
    file.write_text(text, encoding="utf-8")
    path = file.with_suffix(".yaml")
    path.write_text(f"law: python\nfile: {file.name}\n", encoding="utf-8")
    return read_document(path)


@functools.cache
def _temporary_folder() -> Path:
    """A folder for as long as this process lives."""
    folder = tempfile.mkdtemp(prefix="abhv-mc-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def make_flight_plan(
    mission: Input, vehicle: Input = DEFAULT_VEHICLE, controller: Input = "tlc"
) -> "FlightPlan":
    """The plan that a controller flies: reference, gains, start. Raises InputError."""
    from abhv_mc.flight.prepare import prepare

    craft: Any = make_document("vehicle", vehicle)  # read as the files that they stand for
    asked: Any = make_document("mission", mission)
    law: Any = make_document("control", controller)
    return prepare(craft, asked, law, law.path.stem)


def make_parameters(
    dispersions: Mapping[str, Quantity] | None, vehicle: "Vehicle"
) -> "NDArray[np.float64]":
    """One row of all parameters [1, parameter], those named replaced. Raises InputError for an unknown one."""
    from abhv_mc.flight.vehicle_parameters import vehicle_parameters
    from abhv_mc.user_code.vehicle_functions import find_code

    known = vehicle_parameters(find_code(vehicle))
    row = known.nominal[None].copy()
    for name, value in check_mapping(
        {} if dispersions is None else dispersions, "dispersions"
    ).items():
        if name not in known.dispersible:
            raise InputError("dispersions", f"parameter '{name}'", one_of(known.dispersible, name))
        try:
            dimension = dimension_of(known[name].unit)
            row[0, known.index[name]] = parse_quantity(value, dimension, dimension.unit)
        except Refusal as refusal:
            raise InputError("dispersions", f"{name}: {refusal.found}", refusal.expected) from None
    return row


def check_mapping(value: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """The value itself. Raises InputError, which calls it ``name``, where it is no mapping."""
    if not isinstance(value, Mapping):
        raise InputError(name, describe(value), "a mapping")
    return value


def to_si(value: Quantity, dimension: Dimension, name: str) -> float:
    """A number in SI as it is, text by its unit. Raises InputError, which calls it ``name``."""
    try:
        return parse_quantity(value, dimension, dimension.unit)
    except Refusal as refusal:
        raise InputError(name, refusal.found, refusal.expected) from None


def write_inputs(data: Mapping[str, Any], folder: Path) -> Path:
    """Write a campaign and all that it refers to into a folder; the campaign's path. Raises InputError."""
    content = dict(data)
    for key, kind in (("vehicle", "vehicle"), ("mission", "mission")):
        if key in content:
            content[key] = _write_input(kind, content[key], folder, key)
    controllers = content.get("controllers")
    if isinstance(controllers, str):
        controllers = {Path(controllers).stem: controllers}
    if isinstance(controllers, Mapping):
        content["controllers"] = {
            str(name): _write_input("control", given, folder, f"controllers/{number}")
            for number, (name, given) in enumerate(controllers.items())
        }
    path = folder / "campaign.yaml"
    write_document(path, content)
    return path


def _write_input(kind: str, given: Any, folder: Path, place: str) -> str:
    """Write an input and the files that it names, these as they lie to each other; its path from the folder."""
    from abhv_mc.campaign.file.kinds import find_references

    document = make_document(kind, given)
    path = document.path.resolve()
    files = list(find_references(path)) if path.is_file() else []
    root = Path(os.path.commonpath([file.parent for file in (path, *files)]))
    for file in files:
        target = folder / place / file.relative_to(root)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
    name = path.relative_to(root) if path.is_file() else Path(f"{kind}.yaml")
    (folder / place / name).parent.mkdir(parents=True, exist_ok=True)
    write_document(folder / place / name, document.data)
    return f"{place}/{name.as_posix()}"
