"""SHA-256 of a campaign's files: taken as each is put whole, listed in the manifest, checked before a file is read."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from abhv_mc.folder.layout import CampaignFolder, hash_file, recording
from abhv_mc.folder.lock import lock_holder
from abhv_mc.folder.manifest import Manifest, read_manifest
from abhv_mc.io.input_error import InputError

DAMAGED = "a file that is not as the campaign wrote it: damaged, or changed since"
GONE = "no such file, but the manifest names it"


class FileHashes:
    """What a run knows of its folder's files: the manifest's hashes, and those of the files that it writes."""

    def __init__(self, folder: CampaignFolder, known: Mapping[str, str]) -> None:
        self._folder = folder
        self._known = dict(known)

    def note(self, path: Path, digest: str) -> None:
        """A file was written, or proven to be what was written. States of envelopes prove themselves."""
        folder = self._folder
        inside = path.is_relative_to(folder.root) and not path.is_relative_to(
            folder.envelope_states
        )
        if inside and path != folder.manifest:
            self._known[self._name(path)] = digest

    def knows(self, path: Path) -> bool:
        """Whether the file's hash is known; if not, a run was killed before it could list the file."""
        return self._name(path) in self._known

    def damage(self, path: Path) -> str | None:
        """What is wrong with a known file, in words; None for a whole one."""
        if not path.is_file():
            return GONE
        return DAMAGED if hash_file(path) != self._known[self._name(path)] else None

    def paths(self) -> list[Path]:
        """The known files."""
        return [self._folder.root / name for name in sorted(self._known)]

    def listed(self) -> dict[str, str]:
        """Hashes of all files, for the manifest."""
        return dict(sorted(self._known.items()))

    def forget(self, *paths: Path) -> None:
        """Files that the run has removed, or is about to write anew."""
        for path in paths:
            self._known.pop(self._name(path), None)

    def _name(self, path: Path) -> str:
        return path.relative_to(self._folder.root).as_posix()


@contextlib.contextmanager
def record_hashes(folder: CampaignFolder, known: Mapping[str, str]) -> Iterator[FileHashes]:
    """The hashes that are known, and those of all files that are put whole in the folder meanwhile."""
    hashes = FileHashes(folder, known)
    with recording(hashes.note):
        yield hashes


def find_damage(
    folder: CampaignFolder, manifest: Manifest, paths: Iterable[Path] | None = None
) -> Iterator[tuple[Path, str]]:
    """What of the folder (or of ``paths`` in it) is not as the campaign wrote it, each file with what is wrong."""
    files = FileHashes(folder, manifest.files)
    for path in files.paths() if paths is None else [path for path in paths if files.knows(path)]:
        if words := files.damage(path):
            yield path, words


def read_checked(folder: CampaignFolder, paths: Iterable[Path] | None = None) -> Manifest:
    """The manifest of a folder whose files (all, or ``paths``) are as the campaign wrote them.

    Raises InputError, which names the first file that is not.
    """
    manifest = read_manifest(folder.manifest)
    for path, words in find_damage(folder, manifest, paths):
        if holder := lock_holder(folder.lock):
            found = (
                f"a file that is not as the manifest says, while {holder} flies a campaign there"
            )
            raise InputError(path, found, "the end of that run, and the same command once more")
        raise damage_error(path, words)
    return manifest


def refuse_changes(folder: CampaignFolder, manifest: Manifest) -> None:
    """For the end of a reading. Raises InputError where a run has replaced or removed files that ``manifest`` names."""
    if not manifest.files.items() <= read_manifest(folder.manifest).files.items():
        found = "files of another campaign, or of more flights, than a moment ago: a run has written here meanwhile"
        raise InputError(folder.root, found, "the folder opened anew, once that run is done")


@contextlib.contextmanager
def unchanged(folder: CampaignFolder, manifest: Manifest) -> Iterator[None]:
    """The same at the end of a block, in the place of any error there: it tells more."""
    try:
        yield
    finally:
        refuse_changes(folder, manifest)


def damage_error(path: Path, words: str) -> InputError:
    """The error for a damaged file, and what helps."""
    wish = "a copy of the file as it was, or the campaign flown anew: another folder (-o DIR), or --fresh"
    return InputError(path, words, wish)


def data_files(folder: CampaignFolder, manifest: Manifest) -> list[Path]:
    """The data files that the manifest names, in the order of their names."""
    single = {folder.samples, folder.envelopes, folder.nominal, folder.reference, folder.margins}
    paths = FileHashes(folder, manifest.files).paths()
    return [
        path
        for path in paths
        if path in single or path.parent in (folder.flights, folder.histories)
    ]
