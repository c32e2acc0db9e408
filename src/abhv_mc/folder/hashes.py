"""SHA-256 of the files of a results folder, checked before a file is read, and its products.

Products are files computed from the inputs and the flights. A run adds flights but never replaces
them. A product is current if it is complete and has the expected key. The key lists all values that
the product depends on and that may change in a folder. Inputs, settings and code are not in the
key, because they are constant in a folder. Workers, blocks and shards are not in the key, because
no result depends on them.
"""

import contextlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq

from abhv_mc.folder import envelope_states
from abhv_mc.folder.layout import CampaignFolder, hash_file, recording
from abhv_mc.folder.lock import lock_holder
from abhv_mc.folder.manifest import Manifest, read_manifest, write_manifest
from abhv_mc.interfaces import REMEDY
from abhv_mc.io.messages import InputError

DAMAGED = "the file is damaged or was changed after the run"
_COPY = f"{REMEDY}; to change the campaign, run an edited copy of campaign.yaml and inputs/"
REPLACED = "a run replaced files of this folder while the files were read"
GONE = "the file is missing, but the manifest lists it"


class FileHashes:
    """Hashes of files in the manifest and of files that a run writes."""

    def __init__(self, folder: CampaignFolder, hashes: Mapping[str, str]) -> None:
        self._folder = folder
        self._known = dict(hashes)

    def note(self, path: Path, digest: str) -> None:
        """Record the hash of a file that has been written or checked.

        Stored values of envelopes have their own checksums and are not recorded.
        """
        folder = self._folder
        inside = path.is_relative_to(folder.root) and not path.is_relative_to(
            folder.envelope_states
        )
        if inside and path != folder.manifest:
            self._known[self._name(path)] = digest

    def knows(self, path: Path) -> bool:
        """Return whether the hash of a file is known.

        The hash is unknown if a run was killed before it listed the file.
        """
        return self._name(path) in self._known

    def damage(self, path: Path) -> str | None:
        """Return a description of the damage of a known file, or None if it is intact."""
        if not path.is_file():
            return GONE
        return DAMAGED if hash_file(path) != self._known[self._name(path)] else None

    def paths(self) -> list[Path]:
        """Return the paths of all known files."""
        return [self._folder.root / name for name in sorted(self._known)]

    def listed(self) -> dict[str, str]:
        """Return the hash of each file by name, for the manifest."""
        return dict(sorted(self._known.items()))

    def write_manifest(self, manifest: Manifest, **changes: Any) -> Manifest:
        """Write the manifest with changed entries and the hashes of the files; return it."""
        manifest = replace(manifest, **changes, files=self.listed())
        write_manifest(self._folder.manifest, manifest)
        return manifest

    def forget(self, *paths: Path) -> None:
        """Remove from the list the files that the run has deleted or will replace."""
        for path in paths:
            self._known.pop(self._name(path), None)

    def _name(self, path: Path) -> str:
        return path.relative_to(self._folder.root).as_posix()


@contextlib.contextmanager
def record_hashes(folder: CampaignFolder, hashes: Mapping[str, str]) -> Iterator[FileHashes]:
    """Yield the known hashes; the hashes of files written in the context are added."""
    recorder = FileHashes(folder, hashes)
    with recording(recorder.note):
        yield recorder


def find_damage(
    folder: CampaignFolder, manifest: Manifest, paths: Iterable[Path] | None = None
) -> Iterator[tuple[Path, str]]:
    """Yield each damaged or missing file with a description of the damage."""
    files = FileHashes(folder, manifest.files)
    for path in files.paths() if paths is None else [path for path in paths if files.knows(path)]:
        if damage := files.damage(path):
            yield path, damage


def read_checked(folder: CampaignFolder, paths: Iterable[Path] | None = None) -> Manifest:
    """Check all files of a folder, or ``paths``, and return the manifest.

    Raise InputError for the first damaged or missing file.
    """
    manifest = read_manifest(folder.manifest)
    for path, damage in find_damage(folder, manifest, paths):
        if holder := lock_holder(folder.lock):
            problem = f"the file differs from the manifest while {holder} runs a campaign there"
            raise InputError(path, problem, "the same command after the run has ended")
        raise damage_error(path, damage)
    return manifest


def refuse_changes(folder: CampaignFolder, manifest: Manifest) -> None:
    """Raise InputError if a run has replaced or removed files listed in ``manifest``.

    Call this function after the files have been read.
    """
    if not manifest.files.items() <= read_manifest(folder.manifest).files.items():
        raise InputError(folder.root, REPLACED, "the same command after the run has ended")


@contextlib.contextmanager
def refuse_changes_after(folder: CampaignFolder, manifest: Manifest) -> Iterator[None]:
    """Call :func:`refuse_changes` at the end of the context, also after an error.

    After an error, changes are reported instead of the error, because they probably caused it.
    """
    try:
        yield
    finally:
        refuse_changes(folder, manifest)


def damage_error(path: Path, damage: str) -> InputError:
    """Return the InputError for a damaged file."""
    is_campaign = path.name == "campaign.yaml" and damage == DAMAGED
    return InputError(path, damage, _COPY if is_campaign else REMEDY)


def data_files(folder: CampaignFolder, manifest: Manifest) -> list[Path]:
    """Return the data files listed in the manifest, sorted by name."""
    single = {folder.samples, folder.envelopes, folder.nominal, folder.reference, folder.margins}
    paths = FileHashes(folder, manifest.files).paths()
    return [
        path
        for path in paths
        if path in single or path.parent in (folder.flights, folder.histories)
    ]


KEY = "key"  # name of the key in JSON files and in Parquet metadata


class Product(NamedTuple):
    """Computed file with its key."""

    path: Path
    key: str

    def is_current(self, files: FileHashes) -> bool:
        """Return whether the file is complete and has the expected key."""
        return files.knows(self.path) and _read_key(self.path) == self.key


def _read_key(path: Path) -> str | None:
    if path.suffix == ".json":
        key: str | None = json.loads(path.read_bytes()).get(KEY)
        return key
    stored = (pq.read_schema(path).metadata or {}).get(f"abhv_mc.{KEY}".encode())
    return None if stored is None else stored.decode()


class Products:
    """Products of a campaign with ``runs`` flights per controller, except histories."""

    def __init__(self, folder: CampaignFolder, controllers: Iterable[str], runs: int) -> None:
        names = " ".join(sorted(controllers))
        self.samples = Product(folder.samples, str(runs))
        self.nominal = Product(folder.nominal, names)
        self.reference = Product(folder.reference, "mission")
        first = min(runs, envelope_states.ENVELOPE_FLIGHTS)
        self.envelopes = Product(folder.envelopes, f"{names} {first}")
        self.margins = Product(folder.margins, names)

    def forget_stale(self, files: FileHashes) -> None:
        """Remove stale products from ``files``, so that a resumed run computes them again."""
        files.forget(
            *(product.path for product in vars(self).values() if not product.is_current(files))
        )
