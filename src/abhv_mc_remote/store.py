"""Results folders in object storage.

A campaign runs in a local folder. Every few seconds, new files are copied to the address, and the
manifest is copied last.
"""

import contextlib
import shutil
import sys
import tempfile
import threading
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pyarrow as pa
from pyarrow import fs as pyarrow_fs

from abhv_mc.folder.layout import CampaignFolder, StorageFullError, is_inside
from abhv_mc.io.address import Address
from abhv_mc.io.input_error import InputError
from abhv_mc_remote.objects import LEASE_NAME, Lease, Objects, open_objects, read_holder

PUSH_INTERVAL = 5.0  # interval in s between copies
_MANIFEST = "manifest.json"


class Remote:
    """Folder in object storage with its local copy."""

    def __init__(self, store: Objects, local: Path, lease: Lease | None = None) -> None:
        """Pair a folder with its local copy; uploads stop if ``lease`` is lost."""
        self.store, self.local, self._lease = store, local, lease
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
                problem = f"the name of the object '{name}' points outside the folder"
                raise InputError(
                    str(self.store.address), problem, "the unchanged folder of a campaign"
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
            if (
                name != _MANIFEST
                and not name.startswith(LEASE_NAME)
                and not name.endswith(".temporary")
            ):
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
        keeps_copy, ended = False, threading.Event()
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
            print(
                f"{remote.store.address}: {remote.store.address.explain(error)}",
                file=sys.stderr,
                flush=True,
            )
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
        expected = "an address that can be reached"
        raise InputError(str(address), address.explain(error), expected) from error
