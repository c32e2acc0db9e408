"""Where things lie in a campaign's folder, and how a file gets there: whole or not at all."""

import contextlib
import errno
import hashlib
import os
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path

from abhv_mc.io.atomic_write import TEMPORARY, atomic_write
from abhv_mc.io.input_error import InputError, is_printable

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # the last: a limit on a file's size (ulimit -f)
_CLOSED = (
    errno.EACCES,
    errno.EPERM,
    errno.EROFS,
    errno.ENOTDIR,
    errno.EEXIST,
    errno.ENAMETOOLONG,
    errno.ELOOP,
)
_UNWRITABLE = (
    *_CLOSED, errno.EISDIR, errno.ENOTEMPTY, errno.ENOENT, errno.EINVAL, errno.EBUSY, errno.ENOLCK, errno.EOPNOTSUPP,
)  # fmt: skip
_LARGEST_LOG = 1 << 20  # bytes
_recorders: list[Callable[[Path, str], None]] = []  # told of every file that is put whole


class StorageFullError(Exception):
    """The disk is full; what was flown is kept and the same command resumes."""


class CampaignFolder:
    """Paths of a campaign's folder."""

    def __init__(self, root: Path) -> None:
        # pyarrow takes a relative path with a colon for an address.
        self.root = root = root.absolute() if ":" in str(root) else root
        self.campaign = root / "campaign.yaml"
        self.manifest = root / "manifest.json"
        self.samples = root / "samples.parquet"
        self.envelopes = root / "envelopes.parquet"
        self.nominal = root / "nominal.parquet"
        self.reference = root / "reference.parquet"
        self.margins = root / "margins.json"
        self.matrix = root / "verification_matrix.csv"
        self.metrics = root / "metrics.csv"
        self.inputs = root / "inputs"
        self.requirements = root / "requirements"
        self.plans = root / "plans"
        self.flights = root / "flights"
        self.histories = root / "histories"
        self.envelope_states = root / "envelope_states"
        self.explained = root / "explained"
        self.failure_map = self.explained / "failures.json"
        self.log = root / "simulator.log"
        self.lock = root / ".lock"

    def plan(self, controller: str) -> Path:
        return self.plans / f"{controller}.npz"

    def input_files(self) -> list[Path]:
        """The copies of the campaign's input files."""
        return [path for path in sorted(self.inputs.rglob("*")) if path.is_file()]

    @property
    def report(self) -> tuple[Path, ...]:
        """What a report writes."""
        pages = (self.root / f"report.{kind}" for kind in ("html", "json"))
        return (*pages, self.matrix, self.metrics, self.root / "figures")

    @property
    def parts(self) -> tuple[Path, ...]:
        """Everything that a campaign writes, apart from the lock."""
        files = (
            self.campaign,
            self.manifest,
            self.samples,
            self.envelopes,
            self.nominal,
            self.reference,
            self.margins,
            self.log,
        )
        folders = (
            self.inputs,
            self.requirements,
            self.plans,
            self.flights,
            self.histories,
            self.envelope_states,
            self.explained,
        )
        return (*files, *self.report, *folders)

    def refuse_strange(self, fresh: bool) -> None:
        """Raises InputError, without a manifest, for files of others, and for flights that only ``fresh`` deletes."""
        for path in sorted(self.root.iterdir() if self.root.is_dir() else ()):
            is_own = path in self.parts or path.name.startswith(self.lock.name)
            if not is_own and not path.name.endswith(TEMPORARY):
                found = f"a folder with '{path.name}', which no campaign wrote"
                raise InputError(self.root, found, "an empty folder or a campaign's")
        if not fresh and any(self.flights.glob("*.parquet")):
            found = "flights without the manifest that says what they are"
            raise InputError(self.root, found, "another folder (-o DIR), or --fresh to delete them")

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
        folders = [part for part in self.parts if part.is_dir()]
        for path in chain(
            self.root.glob(f"*{TEMPORARY}"), *(folder.rglob(f"*{TEMPORARY}") for folder in folders)
        ):
            path.unlink(missing_ok=True)


def find_user_place(path: Path) -> Path | None:
    """Where in a campaign's folder a path lies that is, or is in, a part of it; empty for the folder itself."""
    target = Path(os.path.realpath(path))
    for root in (target, *target.parents):
        folder = CampaignFolder(root)
        others, parts = (
            (folder.campaign, folder.samples, folder.flights),
            (*folder.parts, folder.lock),
        )
        is_campaigns = folder.manifest.exists() and any(part.exists() for part in others)
        if is_campaigns and (target == root or any(map(target.is_relative_to, parts))):
            return target.relative_to(root)
    return None


def is_inside(name: str) -> bool:
    """Whether a path names something below the folder that it starts from, and can be one."""
    path = Path(name)
    return (
        bool(path.parts)
        and not path.is_absolute()
        and ".." not in path.parts
        and is_printable(name)
    )


@contextlib.contextmanager
def explain_os_error(path: Path, writing: bool = False) -> Iterator[None]:
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
            what = "written" if writing else "written or read"
            found, expected = (
                f"a place that cannot be {what} ({error.strerror})",
                f"a place that can be {what}",
            )
            raise InputError(path, found, expected) from error
        raise


@contextlib.contextmanager
def recording(note: Callable[[Path, str], None]) -> Iterator[None]:
    """Let ``note`` know every file that is put whole meanwhile, with the SHA-256 of what was written."""
    _recorders.append(note)
    try:
        yield
    finally:
        _recorders.remove(note)


def write_whole(path: Path, write: Callable[[Path], object], durable: bool = False) -> None:
    """Put the file that ``write`` makes into place, whole; ``durable`` waits until the disk has it.

    Raises StorageFullError or InputError where the folder takes nothing.
    """
    digest = ""
    with explain_os_error(path, writing=True), atomic_write(path, durable) as temporary:
        write(temporary)
        if _recorders:
            digest = hash_file(temporary)
    for note in _recorders:
        note(path, digest)


def hash_file(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_bytes(
    path: Path, content: bytes, durable: bool = False, executable: bool = False
) -> None:
    """Write a file whole; ``executable`` lets everybody who may read it run it."""

    def write(temporary: Path) -> None:
        temporary.write_bytes(content)
        if executable:
            mode = temporary.stat().st_mode
            temporary.chmod(mode | (mode & 0o444) >> 2)

    write_whole(path, write, durable)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole and durably."""
    write_bytes(path, text.encode(), durable=True)


def append_log(path: Path, head: str, text: str) -> None:
    """Append an excerpt to a log with a line above it; a log of a megabyte takes no more."""
    with explain_os_error(path, writing=True), path.open("a", encoding="utf-8") as file:
        if file.tell() < _LARGEST_LOG:
            file.write(f"== {head}\n{text.rstrip()}\n")
