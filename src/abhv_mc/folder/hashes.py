"""SHA-256 of a campaign's files: taken as each is put whole, held by the manifest, checked before a file is read."""

import contextlib
import hashlib
import os
import stat
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from abhv_mc.folder.layout import CampaignFolder, FolderLostError, hash_file, recording
from abhv_mc.folder.lock import lock_holder
from abhv_mc.folder.manifest import COMPLETE, read_whole_manifest
from abhv_mc.folder.table_check import check_table
from abhv_mc.io.input_error import InputError

_DAMAGED = "a file that is not as the campaign wrote it: damaged, or changed since"
_GONE = "no such file, but the manifest names it"
_STRANGE = "a file that the manifest does not name"
_LINK = "a link that leads out of the folder"
_SPECIAL = "a pipe, socket or device"


class FileHashes:
    """What a run knows of its folder's files: the manifest's hashes, and those of the files that it writes."""

    def __init__(self, root: Path, held: Mapping[str, str]) -> None:
        self._root = root
        self._held = dict(held)

    def note(self, path: Path, digest: str) -> None:
        """A file was written, or proven to be what was written."""
        if path.is_relative_to(self._root) and path != CampaignFolder(self._root).manifest:
            self._held[self._name(path)] = digest

    def knows(self, path: Path) -> bool:
        """Whether the file's hash is known."""
        return self._name(path) in self._held

    def holds(self, path: Path) -> bool:
        """Whether the file is there and known to be as it was written."""
        try:
            return self.knows(path) and hash_file(path) == self._held[self._name(path)]
        except OSError:
            return False

    def adopt(self) -> None:
        """Take the files of a folder whose version kept no hashes as they are."""
        folder = CampaignFolder(self._root)
        for part in folder.parts:
            if part != folder.manifest and part not in folder.report and part != folder.explained:
                for path in [part] if part.is_file() else part.rglob("*"):
                    if path.is_file():
                        self.note(path, hash_file(path))

    def is_content(self, path: Path, content: bytes) -> bool:
        """Whether ``content`` is what was written there."""
        return hashlib.sha256(content).hexdigest() == self._held.get(self._name(path))

    def listed(self) -> dict[str, str]:
        """Hashes of all files, for the manifest."""
        return dict(sorted(self._held.items()))

    def forget(self, path: Path) -> None:
        """A file, or all in a folder, that the run has removed."""
        gone = self._name(path)
        for name in [name for name in self._held if name == gone or name.startswith(f"{gone}/")]:
            del self._held[name]

    def check_presence(self) -> None:
        """Raises FolderLostError where files have gone that nobody here has removed."""
        lost = [name for name in self._held if not (self._root / name).is_file()]
        if lost:
            words = f"{len(lost)} files of the campaign, {lost[0]} among them, are gone: deleted meanwhile"
            raise FolderLostError(f"{self._root}: {words}. The same command makes them anew.")

    def _name(self, path: Path) -> str:
        return path.relative_to(self._root).as_posix()


@contextlib.contextmanager
def record_hashes(root: Path, held: Mapping[str, str]) -> Iterator[FileHashes]:
    """The hashes that are known, and those of all files that are put whole below ``root`` meanwhile."""
    hashes = FileHashes(root, held)
    with recording(hashes.note):
        yield hashes


def refuse_links(root: Path) -> None:
    """Raises InputError for a link in the folder that leads out of it: what it leads to is not the campaign's.

    And for what is neither a file nor a folder: a pipe that is read makes its reader wait for ever. And for a folder
    that cannot be listed: what lies in it would silently be left out.
    """
    base = Path(os.path.realpath(root))  # which stands links in circles
    for path in sorted(_content(root)):
        if path.is_symlink() and not Path(os.path.realpath(path)).is_relative_to(base):
            raise InputError(path, None, None, _LINK, "files of the campaign's own, as it wrote them")
        try:
            mode = path.lstat().st_mode
        except FileNotFoundError:  # gone since, as files that a run writes aside go
            continue
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode) or stat.S_ISLNK(mode)):
            raise InputError(path, None, None, _SPECIAL, "files of the campaign's own, as it wrote them")


def _content(root: Path) -> Iterator[Path]:
    """All files and folders below ``root``. Raises InputError for a folder whose files nobody here may list."""

    def refuse(error: OSError) -> None:
        if isinstance(error, PermissionError):
            found = "a folder that may not be read"
            raise InputError(error.filename, None, None, found, "one that its reader may list") from None

    for place, folders, files in os.walk(root, onerror=refuse):  # others are gone since, as a run removes its own
        yield from (Path(place, name) for name in (*folders, *files))


def find_damage(
    folder: CampaignFolder, manifest: Mapping[str, Any], paths: Iterable[Path] | None = None
) -> Iterator[tuple[Path, str]]:
    """What of the folder (or of ``paths`` in it) is not as the campaign wrote it, each file with what is wrong."""
    files = _files_of(folder, manifest)
    if files is None:
        return
    complete = manifest.get("state") == COMPLETE
    asked = None if paths is None else {path.relative_to(folder.root).as_posix() for path in paths}
    for name, known in files.items():
        path = folder.root / name
        if asked is not None and name not in asked:
            continue
        if not complete and path.is_relative_to(folder.envelope_states):  # rewritten as the flights land
            continue
        if not path.is_file():
            yield path, _GONE
        elif hash_file(path) != known:
            yield path, _DAMAGED
    written = set(data_files(folder, None)) if complete else set()
    for path in sorted(written if paths is None else written & set(paths)):
        if path.relative_to(folder.root).as_posix() not in files:
            yield path, _STRANGE


def data_files(folder: CampaignFolder, manifest: Mapping[str, Any] | None) -> list[Path]:
    """The data files of the folder, as far as its manifest names them; all of them without a manifest."""
    paths = [folder.samples, folder.envelopes, folder.nominal, folder.reference, folder.margins]
    paths += [*sorted(folder.flights.glob("*.parquet")), *sorted(folder.histories.glob("*.parquet"))]
    files = None if manifest is None else _files_of(folder, manifest)
    return [
        path
        for path in paths
        if path.is_file() and (files is None or path.relative_to(folder.root).as_posix() in files)
    ]


class CheckedFolder:
    """A folder whose files were checked, and what its manifest said: whoever has read it looks once more.

    A run may extend the campaign or fly another one in its place while a reader takes file after file.
    """

    def __init__(self, root: Path) -> None:
        """Check all files as :func:`read_checked` does. Raises InputError."""
        self.folder = CampaignFolder(root)
        self.manifest = read_whole_manifest(self.folder.manifest)
        self._stamps = self._look()  # before the hashes are taken
        _check(self.folder, self.manifest, None)

    def refuse_changes(self) -> None:
        """Raises InputError where a file that the manifest named has been replaced, changed or removed since."""
        if self._look() != self._stamps:
            found = "files of another campaign, or of more flights, than a moment ago: a run has written here meanwhile"
            raise InputError(self.folder.root, None, None, found, "the folder opened anew, once that run is done")

    def _look(self) -> dict[Path, tuple[int, int, int] | None]:
        """Which file stands at each name, how large and when written: a run puts each of its files in anew."""
        files = _files_of(self.folder, self.manifest)
        paths = data_files(self.folder, None) if files is None else [self.folder.root / name for name in files]
        stamps: dict[Path, tuple[int, int, int] | None] = dict.fromkeys([self.folder.campaign, *paths])
        for path in stamps:
            with contextlib.suppress(OSError):
                found = path.stat()
                stamps[path] = found.st_ino, found.st_mtime_ns, found.st_size
        return {path: stamp for path, stamp in stamps.items() if not path.is_relative_to(self.folder.envelope_states)}


def read_checked(folder: CampaignFolder, paths: Iterable[Path] | None = None) -> dict[str, Any]:
    """The manifest of a folder whose files (all, or ``paths``) are as the campaign wrote them.

    Raises InputError, which names the first file that is not, and a link that leads out of the folder. A folder of an
    older version, which kept no hashes, is read; standard error says so.
    """
    manifest = read_whole_manifest(folder.manifest)
    _check(folder, manifest, paths)
    return manifest


def _check(folder: CampaignFolder, manifest: Mapping[str, Any], paths: Iterable[Path] | None) -> None:
    refuse_links(folder.root)
    for path, found in find_damage(folder, manifest, paths):
        if holder := lock_holder(folder.lock):
            flown = f"a file that is not as the manifest says, while {holder} flies a campaign there"
            raise InputError(path, None, None, flown, "the end of that run, and the same command once more")
        wish = f"the file as it was written: restore it, or make it anew (abhv-mc run CAMPAIGN.yaml -o {folder.root})"
        raise InputError(path, None, None, found, wish)
    for path in data_files(folder, manifest) if paths is None else paths:
        if path.suffix == ".parquet":
            check_table(path)
    if "files" not in manifest and "campaign_hash" in manifest:
        note = "written by an older version, without hashes of its files: damage to them cannot be seen"
        print(f"{folder.root}: {note}", file=sys.stderr)


def _files_of(folder: CampaignFolder, manifest: Mapping[str, Any]) -> dict[str, str] | None:
    """The manifest's hashes; None where it holds none."""
    files = manifest.get("files")
    if files is None:
        return None
    return dict(files)
