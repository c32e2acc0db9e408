"""Paths in a results folder, and functions that write files atomically."""

import contextlib
import errno
import hashlib
import os
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path

from abhv_mc.io.atomic_write import TEMPORARY, atomic_write, check_before_write
from abhv_mc.io.messages import InputError, is_printable

_FULL = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
)  # The cause of EFBIG is a limit on file sizes (ulimit -f).
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
    *(*_CLOSED, errno.EISDIR, errno.ENOTEMPTY, errno.ENOENT),
    *(errno.EINVAL, errno.EBUSY, errno.ENOLCK, errno.EOPNOTSUPP),
)
_LARGEST_LOG = 1 << 20  # maximum size of a log file, bytes
_recorders: list[Callable[[Path, str], None]] = []  # functions called for each file that is written


class StorageFullError(Exception):
    """Error raised if the disk is full; completed flights are kept."""


class CampaignFolder:
    """Paths in a results folder."""

    def __init__(self, root: Path) -> None:
        # pyarrow interprets a relative path with a colon as an address.
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
        self.replayed = root / "replayed"
        self.log = root / "simulator.log"
        self.progress = root / "progress.html"
        self.lock = root / ".lock"

    def plan(self, controller: str) -> Path:
        return self.plans / f"{controller}.npz"

    def input_files(self) -> list[Path]:
        """Return the paths of the copied input files."""
        return [path for path in sorted(self.inputs.rglob("*")) if path.is_file()]

    def replayed_files(self) -> list[Path]:
        """Return the paths of the histories of re-run flights."""
        return sorted(self.replayed.glob("*.parquet"))

    @property
    def report(self) -> tuple[Path, ...]:
        """Paths of the files and folders that belong to the report."""
        pages = (self.root / f"report.{kind}" for kind in ("html", "json"))
        return (*pages, self.matrix, self.metrics, self.root / "figures")

    @property
    def contents(self) -> tuple[Path, ...]:
        """Paths of the files and folders that a campaign writes, except the lock."""
        others = self.root, self.failure_map, self.lock
        return (*(path for path in vars(self).values() if path not in others), *self.report)

    def refuse_foreign_files(self, fresh: bool) -> None:
        """Raise InputError if a folder without a manifest is not empty.

        Files of a campaign are allowed; stored flights only if ``fresh`` permits their deletion.
        """
        for path in sorted(self.root.iterdir() if self.root.is_dir() else ()):
            is_own = path in self.contents or path.name.startswith(self.lock.name)
            if not is_own and not path.name.endswith(TEMPORARY):
                problem = f"the folder contains '{path.name}', which does not belong to a campaign"
                raise InputError(self.root, problem, "an empty folder or the folder of a campaign")
        if not fresh and any(self.flights.glob("*.parquet")):
            raise InputError(
                self.root,
                "the folder has flights, but no manifest",
                "another folder (-o DIR), or --fresh to delete the flights",
            )

    def clear(self) -> None:
        """Delete the files of a campaign, starting with the manifest."""
        import shutil

        check_before_write()
        self.manifest.unlink(missing_ok=True)
        for path in self.contents:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        self.sweep()

    def sweep(self) -> None:
        """Delete unfinished files left by killed processes."""
        folders = [path for path in self.contents if path.is_dir()]
        for path in chain(
            self.root.glob(f"*{TEMPORARY}"), *(folder.rglob(f"*{TEMPORARY}") for folder in folders)
        ):
            path.unlink(missing_ok=True)


def find_in_campaign(path: Path) -> Path | None:
    """Return the path relative to the results folder that contains it; None if there is none.

    The result for the folder itself is an empty path.
    """
    target = Path(os.path.realpath(path))
    for root in (target, *target.parents):
        folder = CampaignFolder(root)
        markers = (folder.campaign, folder.samples, folder.flights)
        contents = (*folder.contents, folder.lock)
        is_campaign = folder.manifest.exists() and any(marker.exists() for marker in markers)
        if is_campaign and (target == root or any(map(target.is_relative_to, contents))):
            return target.relative_to(root)
    return None


def is_inside(name: str) -> bool:
    """Return whether a name is a printable relative path that stays in its folder."""
    path = Path(name)
    return (
        bool(path.parts)
        and not path.is_absolute()
        and ".." not in path.parts
        and is_printable(name)
    )


@contextlib.contextmanager
def explain_os_error(path: Path, writing: bool = False) -> Iterator[None]:
    """Convert OSErrors to StorageFullError (full disk) or InputError (no permission).

    With ``writing``, other errors that prevent writing ``path`` are converted too, such as a
    missing folder.
    """
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise StorageFullError(
                f"{path}: no space left on the disk. Completed flights are kept; free some space "
                "and run the same command again."
            ) from error
        if error.errno in (_UNWRITABLE if writing else _CLOSED):
            action = "written" if writing else "written or read"
            problem = f"the path cannot be {action} ({error.strerror})"
            raise InputError(path, problem, f"a path that can be {action}") from error
        raise


@contextlib.contextmanager
def recording(note: Callable[[Path, str], None]) -> Iterator[None]:
    """Call ``note`` with the path and SHA-256 of each file written in the context."""
    _recorders.append(note)
    try:
        yield
    finally:
        _recorders.remove(note)


def write_whole(path: Path, write: Callable[[Path], object], durable: bool = False) -> None:
    """Replace a file atomically by the output of ``write``.

    With ``durable``, the function waits until the file is on the disk. Raise StorageFullError or
    InputError if it cannot be written.
    """
    digest = ""
    with explain_os_error(path, writing=True), atomic_write(path, durable) as temporary:
        write(temporary)
        if _recorders:
            digest = hash_file(temporary)
    for note in _recorders:
        note(path, digest)


def hash_file(path: Path) -> str:
    """Return the SHA-256 of the content of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_bytes(
    path: Path, content: bytes, durable: bool = False, executable: bool = False
) -> None:
    """Write a file atomically; with ``executable``, all users with read permission may run it."""

    def write(temporary: Path) -> None:
        temporary.write_bytes(content)
        if executable:
            mode = temporary.stat().st_mode
            temporary.chmod(mode | (mode & 0o444) >> 2)

    write_whole(path, write, durable)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically and durably."""
    write_bytes(path, text.encode(), durable=True)


def append_log(path: Path, head: str, text: str) -> None:
    """Append a heading and a message to a log, unless the log is full."""
    check_before_write()
    with explain_os_error(path, writing=True), path.open("a", encoding="utf-8") as file:
        if file.tell() < _LARGEST_LOG:
            file.write(f"== {head}\n{text.rstrip()}\n")
