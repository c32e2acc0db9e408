"""Campaign folders at an address: a campaign flies in a local folder, and what is new there is copied to the address
every few seconds, the manifest last.
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

PUSH_INTERVAL = 5.0  # s: what the loss of this machine costs
_MANIFEST = "manifest.json"


class Remote:
    """A folder at an address, and the local one that it is kept like."""

    def __init__(self, store: Objects, local: Path, lease: Lease | None = None) -> None:
        """``lease``: without it nothing is written once it is lost."""
        self.store, self.local, self._lease = store, local, lease
        self._held: dict[
            str, tuple[int, int] | None
        ] = {}  # what the address holds -> size and time of ours

    def pull(self, pattern: str = "*") -> None:
        """Copy what the address holds into the local folder: all, or the names that fit a pattern."""
        for info in self.store.find():
            name = info.path[len(self.store.base) + 1 :]
            if (
                info.type != pyarrow_fs.FileType.File
                or name.startswith(LEASE_NAME)
                or not fnmatch(name, pattern)
            ):
                continue
            if not is_inside(name):  # an object's name is any text
                found = f"an object named '{name}', which leads out of the folder"
                raise InputError(
                    str(self.store.address), found, "a campaign's folder, as it was written"
                )
            path = self.local / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with (
                self.store.system.open_input_stream(info.path) as source,
                path.open("wb") as target,
            ):
                shutil.copyfileobj(source, target)
            if name.startswith("inputs/simulator/"):  # object stores keep no executable bit
                path.chmod(0o700)
            self._held[name] = _stamp(path)

    def push(self) -> None:
        """Make the address hold what the local folder holds; the manifest, as it was before the others, comes last.

        Raises InputError once another process has taken the lease over.
        """
        manifest = self.local / _MANIFEST
        content = manifest.read_bytes() if manifest.exists() else None
        if (
            content is None and _MANIFEST in self._held
        ):  # deleted: without it, nothing looks like a campaign
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
        if self._lease is not None and self._lease.lost is not None:
            raise self._lease.lost
        self.store.write(name, content)

    def _delete(self, name: str) -> None:
        self.store.delete(name)
        self._held.pop(name, None)


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_size, status.st_mtime_ns


class ObjectStore:
    """Campaign folders at an address, by the contract :class:`abhv_mc.interfaces.Store`."""

    local = None

    def __init__(self, address: Address) -> None:
        self._objects = open_objects(address)

    @contextlib.contextmanager
    def reading(self, pattern: str = "*") -> Iterator[Path]:
        """Yield a temporary copy of the files whose names fit ``pattern``."""
        with tempfile.TemporaryDirectory(prefix="abhv-mc-") as folder:
            copy = Path(folder) / "copy"  # nobody else's folders beside it
            with _explain_store_error(self._objects.address):
                Remote(self._objects, copy).pull(pattern)
            yield copy

    def describe(self, name: str = "") -> tuple[str | None, int]:
        """Return who writes to the folder ``name``, and its size in bytes."""
        objects = self._objects.below(name)
        with _explain_store_error(objects.address):
            holder, _ = read_holder(objects) or (None, "")
            return holder, sum(info.size or 0 for info in objects.find())

    @contextlib.contextmanager
    def writing(self, staging: Path | None = None) -> Iterator[Path]:
        """Yield a local folder whose content goes to the address as it comes, while this process has the lease.

        ``staging``: where the local folder is made, by default in the system's folder for temporary files. A run whose
        lease another process has taken over is interrupted and writes nothing more to the address.
        """
        if staging is not None:
            staging.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix="abhv-mc-", dir=staging)) / "copy"
        folder.mkdir()
        lease = Lease(self._objects)
        remote = Remote(self._objects, folder, lease)
        keep, ended = False, threading.Event()
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
                    keep = True
                    _push_at_last(remote, lease)
                    keep = False
                else:
                    lease.drop()
        finally:
            lease.stop()
            if not keep:
                shutil.rmtree(folder.parent, ignore_errors=True)


def _push(remote: Remote, ended: threading.Event) -> None:
    while not ended.wait(PUSH_INTERVAL):
        try:
            remote.push()
        except (OSError, pa.ArrowException) as error:  # perhaps it goes next time; at last it must
            print(
                f"{remote.store.address}: {remote.store.address.explain(error)}",
                file=sys.stderr,
                flush=True,
            )
        except InputError:  # another process took over: what this one has stays here
            return


def _push_at_last(remote: Remote, lease: Lease) -> None:
    try:
        lease.renew()
        remote.push()
        lease.drop()
    except (OSError, pa.ArrowException, InputError) as error:
        raise StorageFullError(
            f"{remote.store.address}: {remote.store.address.explain(error)}\nWhat was flown is kept in {remote.local}: "
            "go on there with -o, or copy it to the address."
        ) from error


@contextlib.contextmanager
def _explain_store_error(address: Address) -> Iterator[None]:
    """What a store says, as bad input."""
    try:
        yield
    except (OSError, pa.ArrowException) as error:
        raise InputError(
            str(address), address.explain(error), "an address that can be reached"
        ) from error
