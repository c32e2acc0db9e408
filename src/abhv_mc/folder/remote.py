"""Campaign folders at any address that pyarrow.fs knows: s3://, gs://, hdfs://, file://.

A campaign flies in a local folder, and what is new there is copied to the address every few seconds, the manifest last.
An object store has neither locks nor renames: an object appears whole, and the lock is an object with a date that its
holder renews. Two processes that start within a second of each other on one address are told apart by what the
store holds a moment later.
"""

import _thread
import contextlib
import json
import os
import platform
import re
import shutil
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import fs as pyarrow_fs

from abhv_mc.folder.layout import CampaignFolder, StorageFullError, is_inside
from abhv_mc.io.input_error import InputError

PUSH_INTERVAL = 5.0  # s: what the loss of this machine costs
LEASE = 60.0  # s after which a lock that nobody renews is nobody's
RENEWAL = 15.0  # s between renewals, by a thread of their own: a copy may take longer than the lease
_SETTLE = 1.0  # s until a store shows everyone the same
_PATIENCE = 20.0  # s for a store of Google's to answer
_OBJECT_STORES = ("s3", "gcs", "abfs")
_MANIFEST, _LOCK = "manifest.json", ".lock"


def parse_address(path: Path | str) -> str | None:
    """The address that a path on the command line is (its slashes may have been taken for doubled); None for a path."""
    match = re.match(r"([a-z][a-z0-9+.-]+):/+(.*)", str(path))
    if match is None:
        return None
    return f"{match[1]}:///{match[2]}" if match[1] in ("file", "hdfs") else f"{match[1]}://{match[2]}"


def _open(address: str) -> tuple[Any, str]:
    if address.startswith(("gs:", "gcs:")) and "retry_limit_seconds=" not in address:
        address += f"{'&' if '?' in address else '?'}retry_limit_seconds={_PATIENCE:g}"  # 900 s in the library
    try:
        system, base = pyarrow_fs.FileSystem.from_uri(address)
    except (pa.ArrowException, OSError, ValueError) as error:
        found = f"'{address}' ({str(error).splitlines()[0]})"
        raise InputError("address", None, None, found, "s3://bucket/folder, gs://bucket/folder or a path") from None
    return system, base.rstrip("/")


class Remote:
    """A folder at an address, and the local one that it is kept like."""

    def __init__(self, address: str, system: Any, base: str, local: Path) -> None:
        self.address, self.local = address, local
        self._system, self._base = system, base
        self._held: dict[str, tuple[int, int] | None] = {}  # what the address holds -> size and time of ours
        self._token = uuid.uuid4().hex
        self.lost: InputError | None = None  # who has taken the lock over: nothing is written from then on

    def pull(self, pattern: str = "*") -> None:
        """Copy what the address holds into the local folder: all, or the names that fit a pattern."""
        selector = pyarrow_fs.FileSelector(self._base, allow_not_found=True, recursive=True)
        for info in self._system.get_file_info(selector):
            name = info.path[len(self._base) + 1 :]
            if info.type != pyarrow_fs.FileType.File or name.startswith(_LOCK) or not fnmatch(name, pattern):
                continue
            if not is_inside(name):  # an object's name is any text
                found = f"an object named '{name}', which leads out of the folder"
                raise InputError(self.address, None, None, found, "a campaign's folder, as it was written")
            path = self.local / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with self._system.open_input_stream(info.path) as source, path.open("wb") as target:
                shutil.copyfileobj(source, target)
            self._held[name] = _stamp(path)

    def push(self) -> None:
        """Make the address hold what the local folder holds; the manifest, as it was before the others, comes last."""
        manifest = self.local / _MANIFEST
        content = manifest.read_bytes() if manifest.exists() else None
        if content is None and _MANIFEST in self._held:  # deleted: without it, nothing looks like a campaign
            self._delete(_MANIFEST)
        names = [p.relative_to(self.local).as_posix() for p in sorted(self.local.rglob("*")) if p.is_file()]
        for name in names:
            if name not in (_MANIFEST, _LOCK) and not name.endswith(".aside"):
                self._upload(name)
        if content is not None:
            self._write(_MANIFEST, content)
            self._held[_MANIFEST] = None
        for name in self._held.keys() - set(names):
            self._delete(name)

    def _upload(self, name: str) -> None:
        path = self.local / name
        with contextlib.suppress(FileNotFoundError):  # it was there a moment ago
            stamp = _stamp(path)
            if self._held.get(name) != stamp:
                self._write(name, path.read_bytes())
                self._held[name] = stamp

    def _write(self, name: str, content: bytes) -> None:
        if self.lost is not None:
            raise self.lost
        place = f"{self._base}/{name}"
        if self._system.type_name not in _OBJECT_STORES:
            self._system.create_dir(place.rpartition("/")[0], recursive=True)
        with self._system.open_output_stream(place) as stream:
            stream.write(content)

    def _delete(self, name: str) -> None:
        with contextlib.suppress(FileNotFoundError):
            self._system.delete_file(f"{self._base}/{name}")
        self._held.pop(name, None)

    def take_lock(self) -> None:
        """Raises InputError, which names the holder, where another process has renewed it lately."""
        self._check_holder(abandoned=self._is_abandoned())
        self._write_lock()
        time.sleep(_SETTLE)
        self._check_holder()

    def renew_lock(self) -> None:
        """Say that this process still flies here. Raises InputError where another one has taken over."""
        try:
            self._check_holder()
        except InputError as error:
            self.lost = error
        self._write_lock()

    def holder(self) -> str | None:
        """Who flies here, or was killed at it within the lease; None for nobody."""
        try:
            with self._system.open_input_stream(f"{self._base}/{_LOCK}") as stream:
                held = json.loads(stream.read())
            return f"process {held['pid']} on {held['host']}"
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError):
            return "another process"

    def size(self) -> int:
        """Bytes of all objects."""
        selector = pyarrow_fs.FileSelector(self._base, allow_not_found=True, recursive=True)
        return sum(info.size or 0 for info in self._system.get_file_info(selector))

    def _write_lock(self) -> None:
        who = {"pid": os.getpid(), "host": platform.node(), "token": self._token}
        self._write(_LOCK, json.dumps(who).encode())

    def drop_lock(self) -> None:
        """Let others fly here."""
        if self.lost is None:
            self._check_holder()
            self._delete(_LOCK)

    def _is_abandoned(self) -> bool:
        """Whether nobody has renewed the lock for long, by the store's clock alone: two hosts' may differ by hours."""
        probe = f"{_LOCK}.{self._token}"
        self._write(probe, b"")
        try:
            held, now = self._system.get_file_info([f"{self._base}/{_LOCK}", f"{self._base}/{probe}"])
        finally:
            self._delete(probe)
        return held.mtime is not None and now.mtime is not None and (now.mtime - held.mtime).total_seconds() > LEASE

    def _check_holder(self, abandoned: bool = False) -> None:
        try:
            with self._system.open_input_stream(f"{self._base}/{_LOCK}") as stream:
                held = json.loads(stream.read())
            if held["token"] == self._token or abandoned:
                return
            holder = f"process {held['pid']} on {held['host']}"
        except FileNotFoundError:
            return
        except (ValueError, KeyError, TypeError):
            holder = "another process"
        wish = f"its end (or {LEASE:g} s after it was killed), or another address"
        raise InputError(self.address, None, None, f"a campaign that {holder} is flying", wish)


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_size, status.st_mtime_ns


def local_path(path: Path) -> Path | None:
    """The path itself, or what a ``file://`` address says; None for an address elsewhere."""
    address = parse_address(path)
    if address is None:
        return path
    system, base = _open(address)
    return Path(base) if system.type_name == "local" else None


@contextlib.contextmanager
def fetched(path: Path) -> Iterator[Path]:
    """A campaign's folder to read: ``path``, or a copy for a while of what is at an address."""
    local = local_path(path)
    if local is not None:
        yield local
        return
    address = str(parse_address(path))
    with tempfile.TemporaryDirectory(prefix="abhv-mc-") as folder:
        with _told_plainly(address):
            Remote(address, *_open(address), Path(folder)).pull()
        yield Path(folder)


@contextlib.contextmanager
def fetched_manifests(
    path: Path, pattern: str
) -> Iterator[tuple[Path, Callable[[str], tuple[str | None, int]] | None]]:
    """``path``, or a copy of its files that fit ``pattern``, and what else there is to say of folders there."""
    local = local_path(path)
    if local is not None:
        yield local, None
        return
    address = str(parse_address(path))
    system, base = _open(address)

    def describe(name: str) -> tuple[str | None, int]:
        one = Remote(address, system, f"{base}/{name}".rstrip("/"), Path())
        return one.holder(), one.size()

    with tempfile.TemporaryDirectory(prefix="abhv-mc-") as folder, _told_plainly(address):
        Remote(address, system, base, Path(folder)).pull(pattern)
        yield Path(folder), describe


@contextlib.contextmanager
def mirrored(path: Path, staging: Path | None = None) -> Iterator[Path]:
    """A campaign's folder to fly in: ``path``, or a local one whose content goes to the address as it comes.

    ``staging``: where the local one is made, by default in the system's folder for temporary files. A run whose lease
    another process has taken over is interrupted, writes nothing more to the address, and says so.
    Raises InputError where another process flies there, and StorageFullError, which names the local folder that is
    kept, where the address takes nothing in the end.
    """
    local = local_path(path)
    if local is not None:
        yield local
        return
    address = str(parse_address(path))
    if staging is not None:
        staging.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix="abhv-mc-", dir=staging))
    remote = Remote(address, *_open(address), folder)
    keep = False
    ended = threading.Event()
    threads = [threading.Thread(target=work, args=(remote, ended), daemon=True) for work in (_renew, _push)]
    try:
        with _told_plainly(address):
            remote.take_lock()
            threads[0].start()
            remote.pull()
        threads[1].start()
        try:
            yield folder
        finally:
            ended.set()
            threads[1].join()
            if CampaignFolder(folder).manifest.exists():
                keep = True
                _push_at_last(remote)
                keep = False
            else:
                remote.drop_lock()
    finally:
        ended.set()
        if not keep:
            shutil.rmtree(folder, ignore_errors=True)


def _renew(remote: Remote, ended: threading.Event) -> None:
    """Renew the lease until the end; interrupt the run where another process has it."""
    while not ended.wait(RENEWAL):
        try:
            remote.renew_lock()
        except InputError as error:
            print(f"{error}\nThis run stops, and writes nothing more there.", file=sys.stderr, flush=True)
            _thread.interrupt_main()
            return
        except (OSError, pa.ArrowException):  # perhaps it goes next time
            continue


def _push(remote: Remote, ended: threading.Event) -> None:
    while not ended.wait(PUSH_INTERVAL):
        try:
            remote.push()
        except (OSError, pa.ArrowException) as error:  # perhaps it goes next time; at last it must
            print(f"{remote.address}: {str(error).splitlines()[0]}", file=sys.stderr, flush=True)
        except InputError:  # another process took over: what this one has stays here
            return


def _push_at_last(remote: Remote) -> None:
    try:
        remote.renew_lock()
        remote.push()
        remote.drop_lock()
    except (OSError, pa.ArrowException, InputError) as error:
        raise StorageFullError(
            f"{remote.address}: {str(error).splitlines()[0]}\nWhat was flown is kept in {remote.local}: "
            "go on there with -o, or copy it to the address."
        ) from error


@contextlib.contextmanager
def _told_plainly(address: str) -> Iterator[None]:
    """What a store says, as bad input."""
    try:
        yield
    except (OSError, pa.ArrowException) as error:
        raise InputError(address, None, None, str(error).splitlines()[0], "an address that can be reached") from error
