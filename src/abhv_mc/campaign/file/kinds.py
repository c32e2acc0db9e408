"""Recognition of the kinds of input files."""

import functools
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, get_args

from abhv_mc.campaign.file.systems import find_simulator, load_simulators
from abhv_mc.io.documents import Document, read_document
from abhv_mc.io.messages import InputError, found_value, quoted

_CAMPAIGN = "campaign"


@functools.cache
def _models() -> dict[str, str]:
    """Return 'module:name' of the model of each kind of files that a simulator defines."""
    return {
        kind: model
        for simulator in load_simulators().values()
        for kind, model in simulator.files.items()
    }


def find_kinds() -> tuple[str, ...]:
    """Return the kinds of input files: campaign files, and those that the simulators define."""
    return _CAMPAIGN, *_models()


def load_model(kind: str) -> Any:
    """Return the model of a kind of input files, except campaign files."""
    return resolve_name(_models()[kind])


@functools.cache
def _keys(kind: str) -> frozenset[str]:
    """Return the top-level keys of a kind of input files."""
    models = (
        [simulator.keys for simulator in load_simulators().values()]
        if kind == _CAMPAIGN
        else [load_model(kind)]
    )
    if root := models[0].model_fields.get("root"):
        models = list(get_args(root.annotation))
    return frozenset(key for model in models for key in model.model_fields)


def find_kind(path: Path | Document, expected: str | None = None) -> str:
    """Return the kind of an input file. Raise InputError if no kind matches.

    The result is ``expected`` unless another kind has at least two more of the file's keys.
    """
    document = read_document(path)
    keys = set(document.data) if isinstance(document.data, dict) else set()
    if expected == _CAMPAIGN and keys <= {*find_simulator(document).keys.model_fields}:
        return expected
    if expected is not None and keys <= _keys(expected):
        return expected
    kinds = find_kinds()
    shared = {kind: len(keys & _keys(kind)) for kind in kinds}
    kind = max(shared, key=lambda name: (shared[name] + (name == expected), name == expected))
    if not shared[kind] and expected is None:
        raise document.error(
            (),
            found_value(document.data),
            f"the keys of one of these files: {quoted(kinds, 'or')}",
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


def locate(path: Path) -> Path:
    """Return an absolute path in which links to folders are resolved.

    A link to the file itself is not resolved, because paths in the file are relative to the folder
    of the link.
    """
    return path.parent.resolve() / path.name
