"""Results folders in object storage.

A campaign runs in a local folder. Every few seconds, new files are copied to the address, and the
manifest is copied last.

An object store (accessed by pyarrow.fs) has neither locks nor renames, but an object appears only
when it is complete and has a time stamp of the store. Therefore one object, the lease, names the
writing process, which renews the lease in a thread. If two processes start within a second of each
other, the lease belongs to the process that writes it later.
"""

import _thread
import contextlib
import json
import os
import platform
import shutil
import tempfile
import threading
import time
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import fs as pyarrow_fs

from abhv_mc.folder.layout import CampaignFolder, StorageFullError, is_inside
from abhv_mc.io.address import Address
from abhv_mc.io.messages import InputError, notify

_PATIENCE = 20.0  # time limit in s for replies of Google Cloud Storage
_OBJECT_STORES = ("s3", "gcs", "abfs")
LEASE_NAME = ".lock"
LEASE = 60.0  # time in s after which a lease expires unless renewed
RENEWAL = 15.0  # interval in s between renewals of a lease
_SETTLE = 1.0  # time in s until all readers of a store see the same content


@dataclass
class Objects:
    """Objects in a folder; methods raise OSError or errors of pyarrow if the store fails."""

    address: Address
    system: Any
    base: str

    def below(self, name: str) -> "Objects":
        """Return a subfolder of this folder."""
        return Objects(self.address, self.system, f"{self.base}/{name}".rstrip("/"))

    def find(self) -> list[Any]:
        """Return the file information of all objects, including those in subfolders."""
        selector = pyarrow_fs.FileSelector(self.base, allow_not_found=True, recursive=True)
        objects: list[Any] = self.system.get_file_info(selector)
        return objects

    def read(self, name: str) -> bytes:
        """Return the content of an object. Raise FileNotFoundError if it is missing."""
        with self.system.open_input_stream(f"{self.base}/{name}") as stream:
            return bytes(stream.read())

    def write(self, name: str, content: bytes) -> None:
        """Write an object, replacing an existing object with the same name."""
        path = f"{self.base}/{name}"
        if self.system.type_name not in _OBJECT_STORES:
            self.system.create_dir(path.rpartition("/")[0], recursive=True)
        with self.system.open_output_stream(path) as stream:
            stream.write(content)

    def delete(self, name: str) -> None:
        """Delete an object if it exists."""
        with contextlib.suppress(FileNotFoundError):
            self.system.delete_file(f"{self.base}/{name}")

    def ages(self, *names: str) -> list[Any]:
        """Return modification times by the store's clock, None for a missing object."""
        return [
            info.mtime
            for info in self.system.get_file_info([f"{self.base}/{name}" for name in names])
        ]


def open_objects(address: Address) -> Objects:
    """Return the folder at an address. Raise InputError if the address is invalid."""
    uri = address.uri()
    if uri.startswith(("gs:", "gcs:")) and "retry_limit_seconds=" not in uri:
        # The default limit of the library is 900 s.
        uri += f"{'&' if '?' in uri else '?'}retry_limit_seconds={_PATIENCE:g}"
    try:
        system, base = pyarrow_fs.FileSystem.from_uri(uri)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(
            "address",
            f"the address '{address}' cannot be used ({address.explain(error)})",
            "s3://bucket/folder, gs://bucket/folder or a path",
        ) from None
    return Objects(address, system, base.rstrip("/"))


class Lease:
    """Exclusive right of this process to write to an address."""

    def __init__(self, store: Objects) -> None:
        self._store = store
        self._token = uuid.uuid4().hex
        self._ended = threading.Event()
        # Error naming the process that took over the lease; afterwards, no objects are written.
        self.lost: InputError | None = None

    def take(self) -> None:
        """Take the lease, and renew it in a thread until it is dropped.

        If another process takes over the lease, this run is interrupted. Raise InputError, with the
        name of the holder, if another process has a valid lease.
        """
        self._check(abandoned=self._is_abandoned())
        self._write()
        time.sleep(_SETTLE)
        self._check()
        threading.Thread(target=self._renew_until_the_end, daemon=True).start()

    def renew(self) -> None:
        """Renew the lease. Raise InputError if another process has taken over the lease."""
        try:
            self._check()
        except InputError as error:
            self.lost = error
        if self.lost is not None:
            raise self.lost
        self._write()

    def stop(self) -> None:
        """Stop renewing the lease."""
        self._ended.set()

    def drop(self) -> None:
        """Stop renewing the lease and delete it."""
        self.stop()
        if self.lost is None:
            self._check()
            self._store.delete(LEASE_NAME)

    def _renew_until_the_end(self) -> None:
        while not self._ended.wait(RENEWAL):
            try:
                self.renew()
            except InputError as error:
                notify(f"{error}\nThis run stops and writes nothing more to this address.")
                _thread.interrupt_main()
                return
            except (OSError, pa.ArrowException):  # The next renewal may succeed.
                continue

    def _write(self) -> None:
        holder = {"pid": os.getpid(), "host": platform.node(), "token": self._token}
        self._store.write(LEASE_NAME, json.dumps(holder).encode())

    def _is_abandoned(self) -> bool:
        """Return whether the lease has expired, by the clock of the store."""
        probe = f"{LEASE_NAME}.{self._token}"
        self._store.write(probe, b"")
        try:
            renewed, now = self._store.ages(LEASE_NAME, probe)
        finally:
            self._store.delete(probe)
        return renewed is not None and now is not None and (now - renewed).total_seconds() > LEASE

    def _check(self, abandoned: bool = False) -> None:
        """Raise InputError if another process holds a lease that is not `abandoned`."""
        holder = read_holder(self._store)
        if holder is not None and holder[1] != self._token and not abandoned:
            raise InputError(
                str(self._store.address),
                f"{holder[0]} is running a campaign at this address",
                f"the process to end (or {LEASE:g} s to pass after it was killed), or another "
                "address",
            )


def read_holder(store: Objects) -> tuple[str, str] | None:
    """Return the holder of the lease and its token, or None if there is no lease.

    The holder may have been killed since the last renewal.
    """
    try:
        lease = json.loads(store.read(LEASE_NAME))
        return f"process {lease['pid']} on {lease['host']}", lease["token"]
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError):
        return "another process", ""


PUSH_INTERVAL = 5.0  # interval in s between copies
_MANIFEST = "manifest.json"


class Remote:
    """Folder in object storage with its local copy."""

    def __init__(self, store: Objects, local: Path, lease: Lease | None = None) -> None:
        """Pair a folder with its local copy; uploads stop if ``lease`` is lost."""
        self.store = store
        self.local = local
        self._lease = lease
        # Size and time of the local file for each object, by name.
        self._stamps: dict[str, tuple[int, int] | None] = {}

    def pull(self, pattern: str = "*") -> None:
        """Copy the objects whose names match a pattern to the local folder."""
        for info in self.store.find():
            name = info.path[len(self.store.base) + 1 :]
            if (
                info.type != pyarrow_fs.FileType.File
                or name.startswith(LEASE_NAME)
                or not fnmatch(name, pattern)
            ):
                continue
            if not is_inside(name):  # Names of objects can be any string.
                raise InputError(
                    str(self.store.address),
                    f"the name of the object '{name}' points outside the folder",
                    "the unchanged folder of a campaign",
                )
            path = self.local / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with (
                self.store.system.open_input_stream(info.path) as source,
                path.open("wb") as target,
            ):
                shutil.copyfileobj(source, target)
            if name.startswith("inputs/simulator/"):  # Object stores have no executable bit.
                path.chmod(0o700)
            self._stamps[name] = _stamp(path)

    def push(self) -> None:
        """Copy the content of the local folder to the store.

        The manifest is read before the other files and written after them. Raise InputError if
        another process has taken over the lease.
        """
        manifest = self.local / _MANIFEST
        content = manifest.read_bytes() if manifest.exists() else None
        # If the manifest was deleted, delete its object first.
        if content is None and _MANIFEST in self._stamps:
            self._delete(_MANIFEST)
        names = [
            p.relative_to(self.local).as_posix()
            for p in sorted(self.local.rglob("*"))
            if p.is_file()
        ]
        for name in names:
            if not (name.startswith((_MANIFEST, LEASE_NAME)) or name.endswith(".temporary")):
                self._upload(name)
        if content is not None:
            self._write(_MANIFEST, content)
            self._stamps[_MANIFEST] = None
        for name in self._stamps.keys() - set(names):
            self._delete(name)

    def _upload(self, name: str) -> None:
        path = self.local / name
        with contextlib.suppress(
            FileNotFoundError
        ):  # The file may have been deleted since it was listed.
            stamp = _stamp(path)
            if self._stamps.get(name) != stamp:
                self._write(name, path.read_bytes())
                self._stamps[name] = stamp

    def _write(self, name: str, content: bytes) -> None:
        if self._lease is not None and self._lease.lost is not None:
            raise self._lease.lost
        self.store.write(name, content)

    def _delete(self, name: str) -> None:
        self.store.delete(name)
        self._stamps.pop(name, None)


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_size, status.st_mtime_ns


class ObjectStore:
    """Store of results folders at an address (:class:`abhv_mc.interfaces.Store`)."""

    local = None

    def __init__(self, address: Address) -> None:
        self._objects = open_objects(address)

    @contextlib.contextmanager
    def reading(self, pattern: str = "*") -> Iterator[Path]:
        """Yield a temporary copy of the files whose names match ``pattern``."""
        with tempfile.TemporaryDirectory(prefix="abhv-mc-") as folder:
            copy = Path(folder) / "copy"  # The temporary folder contains no other file.
            with _explain_store_error(self._objects.address):
                Remote(self._objects, copy).pull(pattern)
            yield copy

    def describe(self, name: str = "") -> tuple[str | None, int]:
        """Return the writer (None if there is none) and the size in bytes of folder ``name``."""
        objects = self._objects.below(name)
        with _explain_store_error(objects.address):
            holder, _ = read_holder(objects) or (None, "")
            return holder, sum(info.size or 0 for info in objects.find())

    @contextlib.contextmanager
    def writing(self, staging: Path | None = None) -> Iterator[Path]:
        """Yield a local folder whose files are copied to the store during the context.

        ``staging`` is the parent of the local folder, by default the temporary folder of the
        system. If another process takes over the lease, the run is interrupted and writes nothing
        more to the address.
        """
        if staging is not None:
            staging.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix="abhv-mc-", dir=staging)) / "copy"
        folder.mkdir()
        lease = Lease(self._objects)
        remote = Remote(self._objects, folder, lease)
        keeps_copy = False
        ended = threading.Event()
        pushing = threading.Thread(target=_push, args=(remote, ended), daemon=True)
        try:
            with _explain_store_error(self._objects.address):
                lease.take()
                remote.pull()
            pushing.start()
            try:
                yield folder
            finally:
                ended.set()
                pushing.join()
                if CampaignFolder(folder).manifest.exists():
                    keeps_copy = True
                    _finish(remote, lease)
                    keeps_copy = False
                else:
                    lease.drop()
        finally:
            lease.stop()
            if not keeps_copy:
                shutil.rmtree(folder.parent, ignore_errors=True)


def _push(remote: Remote, ended: threading.Event) -> None:
    """Copy new files to the store at intervals until the run has ended."""
    while not ended.wait(PUSH_INTERVAL):
        try:
            remote.push()
        except (OSError, pa.ArrowException) as error:  # The next copy may succeed.
            notify(f"{remote.store.address}: {remote.store.address.explain(error)}")
        except InputError:  # Another process took over the lease; the copy stays local.
            return


def _finish(remote: Remote, lease: Lease) -> None:
    """Copy all new files to the store and drop the lease.

    Raise StorageFullError, with the path of the local copy, if copying fails.
    """
    try:
        lease.renew()
        remote.push()
        lease.drop()
    except (OSError, pa.ArrowException, InputError) as error:
        raise StorageFullError(
            f"{remote.store.address}: {remote.store.address.explain(error)}\n"
            f"Completed flights are kept in {remote.local}: resume with -o and this folder, or "
            "copy the folder to the address."
        ) from error


@contextlib.contextmanager
def _explain_store_error(address: Address) -> Iterator[None]:
    """Convert errors of a store inside the context to InputErrors."""
    try:
        yield
    except (OSError, pa.ArrowException) as error:
        raise InputError(
            str(address), address.explain(error), "an address that can be reached"
        ) from error
