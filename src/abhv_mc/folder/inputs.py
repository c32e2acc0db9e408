"""A campaign independent of where it came from: its inputs as copies, its references inside the folder.

The file as the folder holds it and the copies are all that it takes to fly the campaign again; their hash is its
identity: a folder goes on with the same campaign alone, and seeds of one question are judged together.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abhv_mc.campaign.file.check import check_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.kinds import find_references
from abhv_mc.campaign.file.requirement_set import (
    JUDGING,
    data_of_rows,
    with_requirements,
)
from abhv_mc.campaign.file.requirements import join_requirements, select_requirements
from abhv_mc.campaign.file.simulator import SYSTEMS, systems_key
from abhv_mc.folder.layout import CampaignFolder, is_inside, write_bytes, write_whole
from abhv_mc.folder.manifest import Manifest
from abhv_mc.io.documents import Document, InputError, read_document, write_document
from abhv_mc.io.input_files import read_input

_HEAD = """A campaign as it was flown, with everything that it refers to beside it in inputs/.
Flying it again gives the same results: abhv-mc run campaign.yaml -o ANOTHER_FOLDER"""


@dataclass(frozen=True)
class FolderInputs:
    """A campaign's plain data with references into its folder, and the files that are copied there."""

    document: Document
    copies: dict[str, bytes]  # place in the folder -> content
    hashes: dict[str, str]  # place in the folder -> SHA-256
    executables: frozenset[str] = frozenset()  # places of the copies that are programs

    @property
    def data(self) -> dict[str, Any]:
        return self.document.entries

    @property
    def systems(self) -> dict[str, Any]:
        """What is compared, as the file has it."""
        held: dict[str, Any] = self.data.get(systems_key(self.data)) or {}
        return held

    @property
    def identity(self) -> str:
        """Hash of what rows depend on: the campaign file without requirements and labels, and every file it names."""
        return self._hash_without()

    @property
    def question(self) -> str:
        """Hash of what is asked: the identity without the seed and the number of flights. With unknowns the seed finds
        the points, so that flights of different seeds are not counted together."""
        return self._hash_without(
            "runs", "pooled", *(() if self.data.get("unknowns") else ("seed",))
        )

    def _hash_without(self, *left_out: str) -> str:
        rows = data_of_rows(self.data)
        data = {key: value for key, value in rows.items() if key not in left_out}
        return hashlib.sha256(json.dumps([data, self.hashes], sort_keys=True).encode()).hexdigest()

    @property
    def judged_identity(self) -> str:
        """Hash of the identity and of the requirements."""
        judging = [self.data.get(key) for key in JUDGING]
        return hashlib.sha256(json.dumps([self.identity, judging]).encode()).hexdigest()

    def judged_by(self, changed: Mapping[str, Any]) -> "FolderInputs":
        """Return the inputs with another set of requirements."""
        data = with_requirements(self.data, changed)
        return replace(self, document=replace(self.document, data=data))

    def write_copies(self, folder: CampaignFolder) -> None:
        """Write the copies into the folder."""
        for place, content in self.copies.items():
            write_bytes(folder.root / place, content, executable=place in self.executables)

    def write_campaign(self, folder: CampaignFolder) -> None:
        """Write the campaign file into the folder."""
        write_whole(
            folder.campaign,
            lambda temporary: write_document(temporary, self.data, _HEAD),
            durable=True,
        )


def collect_inputs(campaign: Experiment) -> FolderInputs:
    """What the folder of a checked campaign is to hold of its files."""
    model = campaign.model
    data = dict(campaign.document.entries)
    files: dict[str, Path] = {}
    data |= campaign.simulator.pack(lambda path, place: _take(path, place, files), files)
    if model.channels is not None:
        data["channels"] = _take(model.channels, "inputs/channels", files)
    if isinstance(model.metrics, Path):
        data["metrics"] = read_document(model.metrics).data
    data["runs"] = campaign.runs_at_point
    data["seed"] = model.seed
    if model.sampling.path:
        place = _take(model.sampling.path, "inputs/samples", files)
        data["sampling"] = {**data["sampling"], "path": place}
    copies = {place: read_input(path) for place, path in files.items()}
    programs = frozenset(place for place, path in files.items() if os.access(path, os.X_OK))
    hashes = {place: hashlib.sha256(content).hexdigest() for place, content in copies.items()}
    return FolderInputs(replace(campaign.document, data=data), copies, hashes, programs)


def _take(path: Path, place: str, copies: dict[str, Path]) -> str:
    """Put ``path`` and all that it refers to under ``place``, in the same positions to each other."""
    files = {path.resolve(): None, **dict.fromkeys(find_references(path.resolve()))}
    root = Path(os.path.commonpath([file.parent for file in files]))
    for file in files:
        copy = f"{place}/{file.relative_to(root).as_posix()}"
        if not is_inside(copy):
            raise InputError(
                file, "characters in the file's name that nothing shows", "another name"
            )
        copies[copy] = file
    return f"{place}/{path.resolve().relative_to(root).as_posix()}"


def describe_changes(flown: FolderInputs, asked: FolderInputs, extensible: bool) -> list[str]:
    """What keeps ``asked`` from going on with the folder of ``flown``, in words; empty when nothing does.

    More flights (of an extensible design), more controllers and another way of execution do not.
    """
    shared = [name for name in flown.systems if name in asked.systems]
    old, new = (_flat(_rows_of(data, shared)) for data in (flown.data, asked.data))
    changes = []
    for key in sorted(old.keys() | new.keys()):
        before, after = old.get(key), new.get(key)
        if before == after or key.startswith("controllers."):
            continue
        if key == "runs" and extensible and (before or 0) < (after or 0):
            continue
        changes.append(f"{key}: {_words(before)} -> {_words(after)}")
    for part in (
        "vehicle",
        "mission",
        "samples",
        "channels",
        "simulator",
        *(f"controllers/{name}" for name in shared),
    ):
        for name in sorted(flown.hashes.keys() | asked.hashes.keys()):
            if name.startswith(f"inputs/{part}/") and flown.hashes.get(name) != asked.hashes.get(
                name
            ):
                changes.append(f"{name}: other content")
    return changes


def merge_inputs(flown: FolderInputs, asked: FolderInputs, selected: bool = False) -> FolderInputs:
    """``asked`` and the controllers that only ``flown`` has, with their requirements.

    The first controller, to which requirements apply where they name none, is that of ``asked``; where that is
    ``selected`` controllers of a campaign it stays that of ``flown``.
    """
    first, then = (flown, asked) if selected else (asked, flown)
    controllers = {**first.systems, **then.systems, **asked.systems}
    new, old = (part.data.get("requirements") or [] for part in (asked, flown))
    absent = [name for name in controllers if name not in asked.systems]
    kept = [entry for entry in select_requirements(old, absent) if entry.get("controllers")]
    requirements = join_requirements(new, kept, controllers)
    if sorted(map(_order, requirements)) == sorted(map(_order, old)):
        requirements = old  # in their order
    asks = {"asks": flown.data["asks"]} if selected and "asks" in flown.data else {}
    changed = {**asked.data, **asks, "requirements": requirements}
    points = {"points": flown.data["points"]} if "points" in flown.data else {}
    data = with_requirements(
        {**asked.data, **points, "requirements": old, systems_key(asked.data): controllers},
        changed,
    )
    return FolderInputs(
        replace(flown.document, data=data), asked.copies, flown.hashes | asked.hashes
    )


def _order(entry: object) -> str:
    return json.dumps(entry, sort_keys=True)


def _rows_of(data: dict[str, Any], names: list[str]) -> dict[str, Any]:
    """The data that rows of these systems depend on."""
    systems = {SYSTEMS: {name: data[SYSTEMS][name] for name in names}} if SYSTEMS in data else {}
    return {**data_of_rows(data), **systems}


def _flat(value: Any, prefix: str = "") -> dict[str, Any]:
    if isinstance(value, dict) and value:
        flat: dict[str, Any] = {}
        for key, inner in value.items():
            flat |= _flat(inner, f"{prefix}.{key}" if prefix else str(key))
        return flat
    return {prefix: value}


def _words(value: Any) -> str:
    return "nothing" if value is None else json.dumps(value, ensure_ascii=False)


def read_folder_inputs(folder: CampaignFolder, manifest: Manifest) -> FolderInputs:
    """What a folder holds of its campaign's files. Raises InputError."""
    return FolderInputs(read_document(folder.campaign), {}, dict(manifest.inputs))


def read_folder_campaign(folder: CampaignFolder) -> Experiment:
    """The campaign of a results folder. Raises InputError where there is none."""
    return check_campaign(read_document(folder.campaign))


def first_controller(folder: Path) -> str:
    """The first controller, or system, of a results folder: what a command means that names none."""
    return read_folder_campaign(CampaignFolder(folder)).controllers[0]
