"""The four kinds of input file: their models, and which one a file is, by its keys."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from abhv_mc.campaign.file.config import Campaign
from abhv_mc.campaign.file.simulator import SimulatorCampaign
from abhv_mc.control.controller_file import CONTROLLERS, ControllerFile
from abhv_mc.control.mission import Mission
from abhv_mc.io.documents import Document, InputError, describe, one_of, read_document
from abhv_mc.vehicle.document import VehicleDocument

MODELS: dict[str, type[BaseModel]] = {
    "campaign": Campaign,
    "vehicle": VehicleDocument,
    "mission": Mission,
    "controller": ControllerFile,
}
_KEYS: dict[str, set[str]] = {
    **{kind: set(model.model_fields) for kind, model in MODELS.items()},
    "campaign": set(SimulatorCampaign.model_fields),
    "controller": {key for model in CONTROLLERS.values() for key in model.model_fields},
}


def find_kind(path: Path | Document, expected: str | None = None) -> str:
    """The kind of a file, ``expected`` unless two keys more fit another. Raises :class:`InputError` for none."""
    document = read_document(path)
    keys = set(document.data) if isinstance(document.data, dict) else set()
    shared = {kind: len(keys & known) for kind, known in _KEYS.items()}
    kind = max(shared, key=lambda name: (shared[name] + (name == expected), name == expected))
    if not shared[kind] and expected is None:
        raise document.error((), describe(document.data), f"the keys of {one_of(MODELS)}")
    return kind


def files_named(document: Document) -> Iterator[tuple[tuple[str, ...], str, Path]]:
    """Place, kind and path of the files that a campaign names and that are there, whatever else is wrong with it."""
    data: dict[str, Any] = document.data if isinstance(document.data, dict) else {}
    held = data.get("controllers")
    named: list[tuple[tuple[str, ...], str, Any]] = [((kind,), kind, data.get(kind)) for kind in ("vehicle", "mission")]
    named += [
        (("controllers", name), "controller", file) for name, file in (held if isinstance(held, dict) else {}).items()
    ]
    for keys, kind, file in named:
        if isinstance(file, str) and document.resolve(file).is_file():
            yield keys, kind, document.resolve(file)


def find_wrong_kinds(document: Document) -> Iterator[InputError]:
    """What to say of the files that a campaign names and that are of another kind than stands there."""
    for keys, kind, file in files_named(document):
        with contextlib.suppress(InputError):  # of a file that cannot be read, whose reader says so
            if (found := find_kind(file, kind)) != kind:
                yield document.error(keys, f"'{file.name}', a {found} file", f"a {kind} file")
