"""Where things lie in a campaign's folder, and how a file gets there: whole or not at all."""

import contextlib
import errno
import hashlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from abhv_mc.input_error import InputError

_ASIDE = ".aside"  # ending of a file that is being written
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # the last: a limit on a file's size (ulimit -f)
_CLOSED = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR, errno.EEXIST)
_UNWRITABLE = (
    *_CLOSED, errno.EISDIR, errno.ENOTEMPTY, errno.ENOENT, errno.ELOOP, errno.ENAMETOOLONG, errno.EINVAL,
)  # fmt: skip
_recorders: list[Callable[[Path, str], None]] = []  # told of every file that is put whole


class StorageFullError(Exception):
    """The disk is full; what was flown is kept and the same command resumes."""


class FolderLostError(Exception):
    """Files of the campaign went while it flew; the same command makes them anew."""


@dataclass(frozen=True)
class CampaignFolder:
    """Paths of a campaign's folder."""

    root: Path

    def __post_init__(self) -> None:
        if ":" in str(self.root):  # pyarrow takes a relative path with a colon for an address
            object.__setattr__(self, "root", self.root.absolute())

    @property
    def campaign(self) -> Path:
        return self.root / "campaign.yaml"

    @property
    def manifest(self) -> Path:
        return self.root / "manifest.json"

    @property
    def samples(self) -> Path:
        return self.root / "samples.parquet"

    @property
    def envelopes(self) -> Path:
        return self.root / "envelopes.parquet"

    @property
    def nominal(self) -> Path:
        return self.root / "nominal.parquet"

    @property
    def reference(self) -> Path:
        return self.root / "reference.parquet"

    @property
    def inputs(self) -> Path:
        return self.root / "inputs"

    @property
    def plans(self) -> Path:
        return self.root / "plans"

    @property
    def flights(self) -> Path:
        return self.root / "flights"

    @property
    def histories(self) -> Path:
        return self.root / "histories"

    @property
    def envelope_states(self) -> Path:
        return self.root / "envelope_states"

    @property
    def explained(self) -> Path:
        return self.root / "explained"

    @property
    def lock(self) -> Path:
        return self.root / ".lock"

    def plan(self, controller: str) -> Path:
        return self.plans / f"{controller}.npz"

    @property
    def report(self) -> tuple[Path, ...]:
        """What a report writes."""
        return (self.root / "report.html", self.root / "report.md", self.root / "report.json", self.root / "figures")

    @property
    def parts(self) -> tuple[Path, ...]:
        """Everything that a campaign writes, apart from the lock."""
        files = (self.campaign, self.manifest, self.samples, self.envelopes, self.nominal, self.reference)
        folders = (self.inputs, self.plans, self.flights, self.histories, self.envelope_states, self.explained)
        return (*files, *self.report, *folders)

    def strangers(self) -> list[Path]:
        """What lies in the folder that no campaign wrote."""
        if not self.root.is_dir():
            return []
        known = {*self.parts, self.lock}
        return sorted(p for p in self.root.iterdir() if p not in known and not p.name.endswith(_ASIDE))

    def clear(self) -> None:
        """Delete what a campaign wrote, the manifest first, so that no half of it looks whole."""
        import shutil

        self.manifest.unlink(missing_ok=True)
        for path in self.parts:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        self.sweep()

    def sweep(self) -> None:
        """Delete what a killed process was writing."""
        if self.root.is_dir():
            for path in self.root.rglob(f"*{_ASIDE}"):
                path.unlink(missing_ok=True)


@contextlib.contextmanager
def told_plainly(path: Path, writing: bool = False) -> Iterator[None]:
    """Say what a full disk or a closed folder means instead of a bare OSError.

    With ``writing``, all that keeps ``path`` from being written, which elsewhere may be a defect (no such file).
    """
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise StorageFullError(
                f"{path}: no space left. What was flown is kept: make room and run the same command again."
            ) from error
        if error.errno in (_UNWRITABLE if writing else _CLOSED):
            raise InputError(path, None, None, f"a place that cannot be written ({error.strerror})",
                             "a folder that can be written") from error  # fmt: skip
        raise


@contextlib.contextmanager
def recording(note: Callable[[Path, str], None]) -> Iterator[None]:
    """Let ``note`` know every file that is put whole meanwhile, with the SHA-256 of what was written."""
    _recorders.append(note)
    try:
        yield
    finally:
        _recorders.remove(note)


def write_whole(path: Path, write: Callable[[Path], None], durable: bool = False) -> None:
    """Let ``write`` make the file aside, then rename it into place; ``durable`` waits until the disk has it.

    Raises StorageFullError or InputError where the folder takes nothing.
    """
    aside = path.absolute().with_name(f".{path.name}{_ASIDE}")  # the dot hides it from readers of the folder
    with told_plainly(path, writing=True):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            write(aside)
            if durable:
                with aside.open("rb") as file:
                    os.fsync(file.fileno())
            digest = hash_file(aside) if _recorders else ""
            aside.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)
            raise
    for note in _recorders:
        note(path, digest)


def hash_file(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_bytes(path: Path, content: bytes, durable: bool = False) -> None:
    """Write a file whole."""

    def write(aside: Path) -> None:
        aside.write_bytes(content)

    write_whole(path, write, durable)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole and durably."""
    write_bytes(path, text.encode(), durable=True)
