"""Input files of a vehicle's campaign, and the files to which they refer."""

import atexit
import functools
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from abhv_mc.campaign.file.kinds import find_kind, locate
from abhv_mc.io.documents import Document, read_document, write_document
from abhv_mc.io.messages import InputErrors
from abhv_mc_vehicle.control.law_file import USER_LAWS, UserController, find_files

_YAML = (".yaml", ".yml")
_DATA = (".csv", ".parquet", ".pq", ".json", ".gz", ".py")


def check_kinds(document: Document, model: Any) -> None:
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


def find_references(path: Path, seen: frozenset[Path] = frozenset()) -> Iterator[Path]:
    """Yield the files to which a YAML file refers by relative paths, recursively."""
    if path.suffix.lower() not in _YAML or path in seen:
        return
    data = read_document(path).data
    if isinstance(data, dict) and data.get("law") in USER_LAWS:
        from abhv_mc_vehicle.control.controller_file import read_controller

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


@functools.cache
def temporary_folder() -> Path:
    """Return a folder that is deleted when this process ends."""
    folder = tempfile.mkdtemp(prefix="abhv-mc-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def write_input(document: Document, folder: Path, kind: str) -> Path:
    """Write a document, with copies of the files to which it refers, and return its path.

    Relative paths are preserved; documents without a file are named after their ``kind``.
    """
    path = document.path.resolve()
    files = [*find_references(path), path]
    root = Path(os.path.commonpath([file.parent for file in files]))
    for file in files:
        target = folder / file.relative_to(root)
        target.parent.mkdir(parents=True, exist_ok=True)
        if file != path:
            shutil.copyfile(file, target)
    if not path.is_file():
        target = folder / f"{kind}.yaml"
    write_document(target, document.data)
    return target
