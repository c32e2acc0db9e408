"""Recognition of the four kinds of input files, and search for the files that they name."""

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from abhv_mc.campaign.file.config import Campaign
from abhv_mc.campaign.file.simulator import SimulatorCampaign
from abhv_mc.control.law_file import USER_LAWS, UserController, find_files
from abhv_mc.io.documents import (
    Document,
    InputError,
    InputErrors,
    found_value,
    read_document,
)
from abhv_mc.io.phrases import quoted

KINDS = ("campaign", "vehicle", "mission", "controller")


def load_model(kind: str) -> type[BaseModel]:
    """Return the model of a kind of input files; each model is imported on first use."""
    if kind == "campaign":
        return Campaign
    if kind == "vehicle":
        from abhv_mc.vehicle.document import VehicleDocument

        return VehicleDocument
    if kind == "mission":
        from abhv_mc.control.mission import Mission

        return Mission
    from abhv_mc.control.controller_file import ControllerFile

    return ControllerFile


@functools.cache
def _keys(kind: str) -> frozenset[str]:
    """Return the top-level keys of a kind of input files."""
    models: list[type[BaseModel]] = [load_model(kind)]
    if kind == "campaign":
        models.append(SimulatorCampaign)
    if kind == "controller":
        from abhv_mc.control.controller_file import CONTROLLERS

        models = list(CONTROLLERS.values())
    return frozenset(key for model in models for key in model.model_fields)


def find_kind(path: Path | Document, expected: str | None = None) -> str:
    """Return the kind of an input file. Raise InputError if no kind matches.

    The result is ``expected`` unless another kind has at least two more of the file's keys.
    """
    document = read_document(path)
    keys = set(document.data) if isinstance(document.data, dict) else set()
    if expected is not None and keys <= _keys(expected):
        return expected
    shared = {kind: len(keys & _keys(kind)) for kind in KINDS}
    kind = max(shared, key=lambda name: (shared[name] + (name == expected), name == expected))
    if not shared[kind] and expected is None:
        raise document.error(
            (),
            found_value(document.data),
            f"the keys of one of these files: {quoted(KINDS, 'or')}",
        )
    return kind


def require_kind(path: Path, kind: str) -> None:
    """Raise InputError if a file is not of the expected kind."""
    if (actual := find_kind(path, kind)) != kind:
        problem = f"this is a {actual} file"
        expected = f"a {kind} file"
        raise InputError(
            path,
            problem,
            expected + (" (use `abhv-mc run` for a campaign)" * (actual == "campaign")),
        )


def check_kinds(document: Document, model: Campaign) -> None:
    """Raise InputErrors if files named in a campaign are of the wrong kind."""
    named: dict[tuple[str, ...], Path] = {("vehicle",): model.vehicle, ("mission",): model.mission}
    named |= {("controllers", name): file for name, file in model.controllers.items()}
    wrong = []
    for keys, file in named.items():
        kind = keys[0].removesuffix("s")
        if (actual := find_kind(file, kind)) != kind:
            wrong.append(
                document.error(keys, f"'{file.name}' is a {actual} file", f"a {kind} file")
            )
    if wrong:
        raise InputErrors(wrong)


_YAML = (".yaml", ".yml")
_DATA = (".csv", ".parquet", ".pq", ".json", ".gz", ".py")


def locate(path: Path) -> Path:
    """Return an absolute path in which links to folders are resolved.

    A link to the file itself is not resolved, because paths in the file are relative to the folder
    of the link.
    """
    return path.parent.resolve() / path.name


def find_references(path: Path, seen: frozenset[Path] = frozenset()) -> Iterator[Path]:
    """Yield the files to which a YAML file refers by relative paths, recursively."""
    if path.suffix.lower() not in _YAML or path in seen:
        return
    data = read_document(path).data
    if isinstance(data, dict) and data.get("law") in USER_LAWS:
        from abhv_mc.control.controller_file import read_controller

        law = read_controller(path)
        if isinstance(law, UserController):
            yield from (file.resolve() for file in find_files(law).values())
    for text in _named_files(data):
        if Path(text).suffix.lower() in (*_YAML, *_DATA) and not Path(text).is_absolute():
            file = locate(path.parent / text)
            if file.is_file():
                yield file
                yield from find_references(file, seen | {path})


def _named_files(value: Any) -> Iterator[str]:
    """Yield the file names in the data of a vehicle, mission or controller file."""
    for key, inner in value.items() if isinstance(value, dict) else ():
        if key in ("file", "python", "around", "ensemble") and isinstance(inner, str):
            yield inner
    for inner in (
        value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    ):
        yield from _named_files(inner)
