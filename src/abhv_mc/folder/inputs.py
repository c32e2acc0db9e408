"""Copies of input files in a results folder, and hashes that identify the campaign.

The stored campaign file, whose references point to the copies, reproduces the campaign. A run
resumes a folder only if the campaign has the same hash.
"""

import ast
import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from abhv_mc.campaign.file.check import check_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.kinds import locate
from abhv_mc.campaign.file.requirement_set import data_of_rows, with_requirements
from abhv_mc.campaign.file.requirements import join_requirements, select_requirements
from abhv_mc.campaign.file.systems import SYSTEMS, systems_key
from abhv_mc.folder.layout import CampaignFolder, hash_file, is_inside, write_bytes, write_whole
from abhv_mc.folder.manifest import Manifest
from abhv_mc.io.documents import Document, read_document, write_document
from abhv_mc.io.input_files import read_input
from abhv_mc.io.messages import InputError

_HEAD = """Campaign of this folder; the files to which it refers are copied to inputs/.
To reproduce the results: abhv-mc run campaign.yaml -o ANOTHER_FOLDER"""


@dataclass(frozen=True)
class FolderInputs:
    """Campaign file that refers to copies in a results folder, and the copied files.

    File names are relative to the folder.
    """

    document: Document
    copies: dict[str, bytes]  # content of each copied file by name
    hashes: dict[str, str]  # SHA-256 of each input file by name
    executables: frozenset[str] = frozenset()  # names of the copies that are executable

    @property
    def data(self) -> dict[str, Any]:
        """Entries of the campaign file."""
        return self.document.entries

    @property
    def systems(self) -> dict[str, Any]:
        """Entries of the compared controllers or systems, by name."""
        systems = self.data.get(systems_key(self.data)) or {}
        return systems

    @property
    def identity(self) -> str:
        """Hash of all inputs on which flights depend.

        The hash covers the campaign file, without requirements and labels, and all files that the
        campaign file refers to.
        """
        return self._hash_without()

    @property
    def question(self) -> str:
        """Hash of the campaign without its seed and number of flights.

        Campaigns with the same hash can be pooled. With unknown parameters, the seed is included
        because the seed determines the points at which flights are simulated.
        """
        return self._hash_without(
            "runs", "pooled", *(() if self.data.get("unknowns") else ("seed",))
        )

    def _hash_without(self, *excluded: str) -> str:
        rows = data_of_rows(self.data)
        data = {key: value for key, value in rows.items() if key not in excluded}
        return hashlib.sha256(json.dumps([data, self.hashes], sort_keys=True).encode()).hexdigest()

    @property
    def judged_identity(self) -> str:
        """Hash of :attr:`identity` and the requirements."""
        judging = [self.identity, self.data.get("requirements")]
        return hashlib.sha256(json.dumps(judging).encode()).hexdigest()

    def judged_by(self, changed: Mapping[str, Any]) -> "FolderInputs":
        """Return the inputs with another set of requirements."""
        return replace(
            self, document=replace(self.document, data=with_requirements(self.data, changed))
        )

    def write_copies(self, folder: CampaignFolder) -> None:
        """Write the copies into the folder."""
        for name, content in self.copies.items():
            write_bytes(folder.root / name, content, executable=name in self.executables)

    def write_campaign(self, folder: CampaignFolder) -> None:
        """Write the campaign file into the folder."""
        write_whole(
            folder.campaign,
            lambda temporary: write_document(temporary, self.data, _HEAD),
            durable=True,
        )


def collect_inputs(campaign: Experiment) -> FolderInputs:
    """Return the input files of a checked campaign as stored in a results folder."""
    model = campaign.model
    data = dict(campaign.document.entries)
    files: dict[str, Path] = {}
    data |= campaign.simulator.pack(partial(_take, files), files)
    data["runs"] = campaign.runs_at_point
    data["seed"] = model.seed
    data["under_test"] = list(campaign.under_test)
    if model.sampling.path:
        location = _take(files, model.sampling.path, "inputs/samples")
        data["sampling"] = {**data["sampling"], "path": location}
    copies = {location: read_input(path) for location, path in files.items()}
    programs = frozenset(location for location, path in files.items() if os.access(path, os.X_OK))
    hashes = {location: hashlib.sha256(content).hexdigest() for location, content in copies.items()}
    return FolderInputs(replace(campaign.document, data=data), copies, hashes, programs)


def _take(
    copies: dict[str, Path], path: Path, location: str, references: Iterable[Path] = ()
) -> str:
    """Add ``path``, and the files to which it refers, to ``copies`` under ``location``.

    Relative paths are preserved. Return the name of ``path`` in the folder.
    """
    path = locate(path)
    files = {path: None, **dict.fromkeys(references)}
    root = Path(os.path.commonpath([file.parent for file in files]))
    for file in files:
        copy = f"{location}/{file.relative_to(root).as_posix()}"
        if not is_inside(copy):
            raise InputError(
                file, "the file name contains characters that are not printable", "another name"
            )
        copies[copy] = file
    return f"{location}/{path.relative_to(root).as_posix()}"


def content_of(path: Path) -> str:
    """Return YAML data or Python code without comments, or the SHA-256 of any other file."""
    if path.suffix in (".yaml", ".yml"):
        return repr(read_document(path).data)
    return ast.dump(ast.parse(path.read_bytes())) if path.suffix == ".py" else hash_file(path)


def describe_changes(stored: FolderInputs, requested: FolderInputs, extensible: bool) -> list[str]:
    """Return the changes that prevent a run from resuming a folder.

    More flights (of an extensible design), more controllers and changed execution settings do not
    prevent a run from resuming.
    """
    shared = [name for name in stored.systems if name in requested.systems]
    old, new = (_flat(_rows_of(data, shared)) for data in (stored.data, requested.data))
    changes = []
    for key in sorted(old.keys() | new.keys()):
        before, after = old.get(key), new.get(key)
        if before == after or key.startswith("controllers."):
            continue
        if key == "runs" and extensible and (before or 0) < (after or 0):
            continue
        changes.append(f"{key}: {_value_text(before)} -> {_value_text(after)}")
    for kind in (
        "vehicle",
        "mission",
        "samples",
        "channels",
        "simulator",
        *(f"controllers/{name}" for name in shared),
    ):
        for name in sorted(stored.hashes.keys() | requested.hashes.keys()):
            before, after = stored.hashes.get(name), requested.hashes.get(name)
            if name.startswith(f"inputs/{kind}/") and before != after:
                change = (
                    "different content" if before and after else "added" if after else "removed"
                )
                changes.append(f"{name}: {change}")
    return changes


def merge_inputs(stored: FolderInputs, requested: FolderInputs, selected: bool) -> FolderInputs:
    """Return ``requested`` with the additional controllers and requirements of ``stored``.

    If ``requested`` has only ``selected`` controllers of the campaign, the other controllers of
    ``stored`` remain under test.
    """
    first, second = (stored, requested) if selected else (requested, stored)
    controllers = {**first.systems, **second.systems, **requested.systems}
    new, old = (inputs.data.get("requirements") or [] for inputs in (requested, stored))
    absent = [name for name in controllers if name not in requested.systems]
    retained = [entry for entry in select_requirements(old, absent) if entry.get("controllers")]
    requirements = join_requirements(new, retained, controllers)
    if sorted(map(_order, requirements)) == sorted(map(_order, old)):
        requirements = old  # Keep the stored list if only the order differs.
    asks = {"asks": stored.data["asks"]} if selected and "asks" in stored.data else {}
    tested = requested.data["under_test"]
    if selected:
        tested = [
            name
            for name in controllers
            if name in (requested if name in requested.systems else stored).data["under_test"]
        ]
    changed = {**requested.data, **asks, "requirements": requirements, "under_test": tested}
    points = {"points": stored.data["points"]} if "points" in stored.data else {}
    data = with_requirements(
        {**requested.data, **points, "requirements": old, systems_key(requested.data): controllers},
        changed,
    )
    return FolderInputs(
        replace(stored.document, data=data), requested.copies, stored.hashes | requested.hashes
    )


def _order(entry: object) -> str:
    return json.dumps(entry, sort_keys=True)


def _rows_of(data: dict[str, Any], names: list[str]) -> dict[str, Any]:
    """Return the entries on which the flights of the named systems depend."""
    systems = {SYSTEMS: {name: data[SYSTEMS][name] for name in names}} if SYSTEMS in data else {}
    return {**data_of_rows(data), **systems}


def _flat(value: Any, prefix: str = "") -> dict[str, Any]:
    if isinstance(value, dict) and value:
        flat: dict[str, Any] = {}
        for key, inner in value.items():
            flat |= _flat(inner, f"{prefix}.{key}" if prefix else str(key))
        return flat
    return {prefix: value}


def _value_text(value: Any) -> str:
    return "nothing" if value is None else json.dumps(value, ensure_ascii=False)


def read_folder_inputs(folder: CampaignFolder, manifest: Manifest) -> FolderInputs:
    """Return the inputs stored in a folder. Raise InputError if the inputs are invalid."""
    return FolderInputs(read_document(folder.campaign), {}, dict(manifest.inputs))


def read_folder_campaign(folder: CampaignFolder) -> Experiment:
    """Return the campaign of a results folder. Raise InputError if there is no campaign."""
    return check_campaign(read_document(folder.campaign))
