"""A campaign made independent of where it came from: its inputs as copies, its references inside the folder.

The resolved file and the copies are all that it takes to fly the campaign again; their hash is its identity.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abhv_mc.campaign.file.check import CheckedCampaign, check_campaign
from abhv_mc.campaign.file.requirements import join_requirements, select_requirements
from abhv_mc.control.law_file import find_law_files
from abhv_mc.folder.hashes import FileHashes, refuse_links
from abhv_mc.folder.layout import CampaignFolder, hash_file, is_inside, write_bytes, write_whole
from abhv_mc.io.documents import Document, InputError, read_document, write_document

_YAML = (".yaml", ".yml")
_DATA = (".csv", ".parquet", ".pq", ".json", ".gz", ".py")
_HEAD = """A campaign as it was flown, with everything that it refers to beside it in inputs/.
Flying it again gives the same results: abhv-mc run campaign.yaml -o ANOTHER_FOLDER"""


@dataclass(frozen=True)
class ResolvedCampaign:
    """A campaign's plain data with references into its own folder, and the files to copy there."""

    document: Document
    copies: dict[str, bytes]  # place in the folder -> content; read before anything there may be deleted
    hashes: dict[str, str]  # place in the folder -> SHA-256

    @property
    def data(self) -> dict[str, Any]:
        return self.document.data  # type: ignore[return-value]

    @property
    def identity(self) -> str:
        """Hash of all that results depend on: not of how it is flown."""
        data = {key: value for key, value in self.data.items() if key != "execution"}
        text = json.dumps([data, self.hashes], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def write(self, folder: CampaignFolder) -> None:
        """Write the copies and the resolved file into the folder."""
        for place, content in self.copies.items():
            write_bytes(folder.root / place, content)
        write_whole(folder.campaign, lambda aside: write_document(aside, self.data, _HEAD), durable=True)


def resolve_campaign(campaign: CheckedCampaign) -> ResolvedCampaign:
    """Resolve every reference of a checked campaign."""
    model = campaign.model
    data: dict[str, Any] = dict(campaign.document.data)  # type: ignore[arg-type]
    copies: dict[str, bytes] = {}
    data["vehicle"] = _take(model.vehicle, "inputs/vehicle", copies)
    data["mission"] = _take(model.mission, "inputs/mission", copies)
    data["controllers"] = {
        name: _take(path, f"inputs/controllers/{name}", copies) for name, path in model.controllers.items()
    }
    if model.channels is not None:
        data["channels"] = _take(model.channels, "inputs/channels", copies)
    if isinstance(model.metrics, Path):
        data["metrics"] = read_document(model.metrics).data
    data["runs"] = campaign.runs
    data["seed"] = model.seed
    if model.sampling.path:
        place = _take(model.sampling.path, "inputs/samples", copies)
        data["sampling"] = {**data["sampling"], "path": place}
    hashes = {place: hashlib.sha256(content).hexdigest() for place, content in copies.items()}
    return ResolvedCampaign(replace(campaign.document, data=data), copies, hashes)


def refuse_changes(campaign: CheckedCampaign, resolved: ResolvedCampaign) -> None:
    """Raises InputError where a file that the campaign refers to is no longer as ``resolved`` took it."""
    now = resolve_campaign(campaign)
    if now.identity != resolved.identity:
        files = sorted(now.hashes.keys() | resolved.hashes.keys())
        changed = [place for place in files if now.hashes.get(place) != resolved.hashes.get(place)] or ["metrics"]
        found = f"another content of {changed[0]} than a moment ago: a file was edited meanwhile"
        raise InputError(campaign.document.path, None, None, found, "the same command once more")


def _take(path: Path, place: str, copies: dict[str, bytes]) -> str:
    """Put ``path`` and all that it refers to under ``place``, in the same positions to each other."""
    files = {path.resolve(): None, **dict.fromkeys(find_references(path.resolve()))}
    root = Path(os.path.commonpath([file.parent for file in files]))
    for file in files:
        copy = f"{place}/{file.relative_to(root).as_posix()}"
        if not is_inside(copy):
            raise InputError(file, None, None, "characters in the file's name that nothing shows", "another name")
        copies[copy] = file.read_bytes()
    return f"{place}/{path.resolve().relative_to(root).as_posix()}"


def find_references(path: Path, seen: frozenset[Path] = frozenset()) -> Iterator[Path]:
    """Files that a YAML file names by relative paths, and those that they name."""
    if path.suffix.lower() not in _YAML or path in seen:
        return
    data = read_document(path).data
    yield from (file.resolve() for file in find_law_files(path, data) if file.is_file())
    for text in _named_files(data):
        if Path(text).suffix.lower() in (*_YAML, *_DATA) and not Path(text).is_absolute():
            file = (path.parent / text).resolve()
            if file.is_file():
                yield file
                yield from find_references(file, seen | {path})


def _named_files(value: Any) -> Iterator[str]:
    """What stands at the one key that names a file in the files that a campaign refers to; text elsewhere is text."""
    for key, inner in value.items() if isinstance(value, dict) else ():
        if key == "file" and isinstance(inner, str):
            yield inner
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _named_files(inner)


def describe_changes(held: ResolvedCampaign, wanted: ResolvedCampaign, extensible: bool) -> list[str]:
    """What keeps ``wanted`` from going on with the folder of ``held``, in words; empty when nothing does.

    More flights (of an extensible design), more controllers and another way of execution do not.
    """
    shared = [name for name in held.data["controllers"] if name in wanted.data["controllers"]]
    old, new = (_flat(_for_controllers(data, shared)) for data in (held.data, wanted.data))
    changes = []
    for key in sorted(old.keys() | new.keys()):
        before, after = old.get(key), new.get(key)
        if before == after or key.startswith("execution") or key.startswith("controllers."):
            continue
        if key == "runs" and extensible and (before or 0) < (after or 0):
            continue
        changes.append(f"{key}: {_words(before)} -> {_words(after)}")
    for name in wanted.data["controllers"].keys() - held.data["controllers"].keys():
        twins = [other for other in held.data["controllers"] if other.casefold() == name.casefold()]
        changes += [f"controllers: '{twin}' -> '{name}': names that differ in case alone" for twin in twins]
    for part in ("vehicle", "mission", "samples", "channels", *(f"controllers/{name}" for name in shared)):
        changes += _changed_files(held.hashes, wanted.hashes, f"inputs/{part}/")
    return changes


def merge_campaigns(held: ResolvedCampaign, wanted: ResolvedCampaign, selected: bool = False) -> ResolvedCampaign:
    """``wanted`` and the controllers that only ``held`` has, with their requirements.

    The first controller, to which requirements apply where they name none, is that of ``wanted``; where that is
    ``selected`` controllers of a campaign it stays that of ``held``.
    """
    first, then = (held, wanted) if selected else (wanted, held)
    controllers = {**first.data["controllers"], **then.data["controllers"], **wanted.data["controllers"]}
    new, old = (part.data.get("requirements") or [] for part in (wanted, held))
    requirements = join_requirements(new, old, controllers)
    data = {**wanted.data, "controllers": controllers, "requirements": requirements}
    return ResolvedCampaign(replace(held.document, data=data), wanted.copies, held.hashes | wanted.hashes)


def _for_controllers(data: dict[str, Any], names: list[str]) -> dict[str, Any]:
    """The data with the requirements that apply to these, whatever entries they are written in, in one order."""
    selected = join_requirements(select_requirements(data.get("requirements") or [], names), (), names)
    return {**data, "requirements": sorted(selected, key=lambda entry: json.dumps(entry, sort_keys=True))}


def _changed_files(old: dict[str, str], new: dict[str, str], prefix: str) -> list[str]:
    names = sorted(name for name in old.keys() | new.keys() if name.startswith(prefix))
    return [f"{name}: other content" for name in names if old.get(name) != new.get(name)]


def _flat(value: Any, prefix: str = "") -> dict[str, Any]:
    if isinstance(value, dict) and value:
        flat: dict[str, Any] = {}
        for key, inner in value.items():
            flat |= _flat(inner, f"{prefix}.{key}" if prefix else str(key))
        return flat
    return {prefix: value}


def _words(value: Any) -> str:
    return "nothing" if value is None else json.dumps(value, ensure_ascii=False)


def read_held(folder: CampaignFolder, manifest: dict[str, Any]) -> ResolvedCampaign:
    """The resolved campaign that a folder holds. Raises InputError where it is damaged."""
    wish = "the campaign as it was flown: restore it, or --fresh to delete what was flown and fly it anew"
    hashes = manifest.get("inputs")
    try:
        document = read_document(folder.campaign)
    except InputError as error:
        raise InputError(error.file, error.line, error.column, error.found, wish) from None
    if not isinstance(document.data, dict) or not isinstance(hashes, dict):
        raise InputError(folder.campaign, None, None, "a damaged campaign file or manifest", wish)
    _refuse_outside(folder, document, _references_of(document.data))
    return ResolvedCampaign(document, {}, hashes)


def read_own_campaign(folder: CampaignFolder) -> CheckedCampaign:
    """The campaign of a results folder. Raises InputError where it is none, or refers to files outside the folder."""
    refuse_links(folder.root)
    document = read_document(folder.campaign)
    _refuse_outside(folder, document, _references_of(document.data))
    return check_campaign(document)


def _references_of(data: Any) -> Iterator[str]:
    """What a campaign file names."""
    if isinstance(data, dict):
        controllers, sampling = data.get("controllers"), data.get("sampling")
        named = [
            *(data.get(key) for key in ("vehicle", "mission", "channels", "metrics")),
            *(controllers.values() if isinstance(controllers, dict) else ()),
        ]
        named.append(sampling.get("path") if isinstance(sampling, dict) else None)
        yield from (text for text in named if isinstance(text, str))


def _refuse_outside(folder: CampaignFolder, document: Document, named: Iterable[str]) -> None:
    """Raises InputError for a reference out of the folder: what it leads to is not the campaign's."""
    root = os.path.realpath(folder.root)
    for text in named:
        if not Path(os.path.realpath(document.resolve(text))).is_relative_to(root):
            found = f"'{text}', which leads out of the campaign's folder"
            raise InputError(document.path, None, None, found, "a file in inputs/, as the campaign wrote it")


def restore_folder(
    folder: CampaignFolder, manifest: dict[str, Any], wanted: ResolvedCampaign, files: FileHashes
) -> None:
    """Write the campaign's file and inputs anew where they are damaged and the manifest says that they were these."""
    if wanted.identity != manifest.get("campaign_hash"):
        return
    try:
        held = files.holds(folder.campaign) and read_held(folder, manifest).identity == wanted.identity
        check_inputs(folder, manifest)
    except InputError:
        held = False
    if not held:
        wanted.write(folder)


def check_inputs(folder: CampaignFolder, manifest: dict[str, Any]) -> None:
    """Raises InputError for a copy of an input file that is not as the manifest says."""
    for place, known in manifest["inputs"].items():
        path = folder.root / place
        if not path.is_file() or hash_file(path) != known:
            wish = "the file as it was flown: the same campaign with all its controllers puts it there again"
            raise InputError(path, None, None, "a damaged copy of an input file", wish)
        if path.suffix.lower() in _YAML:
            document = read_document(path)
            _refuse_outside(folder, document, _named_files(document.data))
