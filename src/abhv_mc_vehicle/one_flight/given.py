"""Inputs of a single flight: shipped names, paths or mappings, and dispersions.

A mapping is the content of a file, or ``base`` and changed entries, as in ``{"base": "tlc",
"limits.bank": "60 deg"}``.
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
    one_of,
    read_document,
    write_document,
)
from abhv_mc.io.input_error import check_mapping
from abhv_mc.io.units import Dimension, parse_quantity
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from abhv_mc_vehicle.flight.plan import FlightPlan
    from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle

Input = str | Path | Mapping[str, Any] | Callable[..., Any]
Quantity = float | str  # number in SI (angles in rad), or a string with a unit


def make_document(kind: str, source: Input) -> Document:
    """Return a vehicle, mission or controller as a document.

    Raise InputError if the input is invalid.
    """
    if callable(source):
        return _make_law_document(kind, source)
    if not isinstance(source, Mapping):
        return read_document(find_input(source, kind))
    changes = {str(key): value for key, value in source.items()}
    base = changes.pop("base", None)
    if base is None:
        return Document(Path(f"<{kind}>"), changes, {(): (1, 1)}, {})
    document = read_document(find_input(base, kind))
    data: Any = copy.deepcopy(document.data)
    for key, value in changes.items():
        *path, last = key.split(".")
        node = data
        for i, name in enumerate(path):
            if not isinstance(node, dict) or name not in node:
                keys = node if isinstance(node, dict) else ()
                raise InputError(
                    document.path,
                    f"unknown entry '{'.'.join(path[: i + 1])}'",
                    one_of(keys, name) if keys else "the key of a mapping",
                )
            node = node[name]
        if not isinstance(node, dict):
            raise InputError(document.path, f"unknown entry '{key}'", "the key of a mapping")
        node[last] = value
    return Document(document.path, data, document.value_places, document.key_places)


def _make_law_document(kind: str, law: Callable[..., Any]) -> Document:
    """Return a controller document for a function, with the current source of the function."""
    from abhv_mc_vehicle.user_code.from_function import make_law_text

    if kind != "control":
        raise InputError(kind, "found a function", "a name, a path or a mapping")
    text = make_law_text(law)
    folder = temporary_folder() / hashlib.sha256(text.encode()).hexdigest()[:16]
    folder.mkdir(exist_ok=True)
    file = folder / f"{law.__name__}.py"
    file.write_text(text, "utf-8")
    path = file.with_suffix(".yaml")
    path.write_text(f"law: python\nfile: {file.name}\n", "utf-8")
    return read_document(path)


@functools.cache
def temporary_folder() -> Path:
    """Return a folder that is deleted when this process ends."""
    folder = tempfile.mkdtemp(prefix="abhv-mc-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def make_flight_plan(
    mission: Input, vehicle: Input = DEFAULT_VEHICLE, controller: Input = "tlc"
) -> "FlightPlan":
    """Return the plan of a flight. Raise InputError if an input is invalid."""
    from abhv_mc_vehicle.flight.prepare import prepare

    craft: Any = make_document("vehicle", vehicle)  # Documents are accepted in place of paths.
    mission_document: Any = make_document("mission", mission)
    law: Any = make_document("control", controller)
    return prepare(craft, mission_document, law, law.path.stem)


def make_parameters(
    dispersions: Mapping[str, Quantity] | None, vehicle: "Vehicle"
) -> "NDArray[np.float64]":
    """Return a row [1, parameter] of nominal parameters changed by dispersions.

    Raise InputError for an unknown parameter.
    """
    from abhv_mc_vehicle.flight.vehicle_parameters import vehicle_parameters
    from abhv_mc_vehicle.user_code.vehicle_functions import find_code

    table = vehicle_parameters(find_code(vehicle))
    row = table.nominal[None].copy()
    for name, value in check_mapping(
        {} if dispersions is None else dispersions, "dispersions"
    ).items():
        if name not in table.dispersible:
            raise InputError(
                "dispersions", f"unknown parameter '{name}'", one_of(table.dispersible, name)
            )
        try:
            row[0, table.index[name]] = table[name].read(value, bare_unit=table[name].unit)
        except Refusal as refusal:
            raise InputError("dispersions", f"{name}: {refusal.found}", refusal.expected) from None
    return row


def to_si(value: Quantity, dimension: Dimension, name: str) -> float:
    """Convert a number or text with unit to SI. Raise InputError if it is invalid."""
    try:
        return parse_quantity(value, dimension, dimension.unit)
    except Refusal as refusal:
        raise InputError(name, refusal.found, refusal.expected) from None


def write_inputs(data: Mapping[str, Any], folder: Path) -> Path:
    """Write a campaign with its input files to a folder; return the path of the campaign."""
    content = dict(data)
    for key, kind in (("vehicle", "vehicle"), ("mission", "mission")):
        if key in content:
            content[key] = _write_input(kind, content[key], folder, key)
    controllers = content.get("controllers")
    if isinstance(controllers, str):
        controllers = {Path(controllers).stem: controllers}
    if isinstance(controllers, Mapping):
        content["controllers"] = {
            str(name): _write_input("control", source, folder, f"controllers/{number}")
            for number, (name, source) in enumerate(controllers.items())
        }
    path = folder / "campaign.yaml"
    write_document(path, content)
    return path


def _write_input(kind: str, source: Any, folder: Path, location: str) -> str:
    """Write an input with the files to which it refers, and return its relative path."""
    from abhv_mc_vehicle.vehicle_simulator.references import find_references

    document = make_document(kind, source)
    path = document.path.resolve()
    files = list(find_references(path)) if path.is_file() else []
    root = Path(os.path.commonpath([file.parent for file in (path, *files)]))
    for file in files:
        target = folder / location / file.relative_to(root)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
    name = path.relative_to(root) if path.is_file() else Path(f"{kind}.yaml")
    (folder / location / name).parent.mkdir(parents=True, exist_ok=True)
    write_document(folder / location / name, document.data)
    return f"{location}/{name.as_posix()}"
