"""Campaign folders at an address: a campaign flies in a local folder, and what is new there is copied to the address
every few seconds, the manifest last.
"""

import contextlib
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from pathlib import Path

import pyarrow as pa
from pyarrow import fs as pyarrow_fs

from abhv_mc.folder.layout import CampaignFolder, StorageFullError, is_inside
from abhv_mc.folder.store import LEASE_NAME, Lease, Store, open_store, read_holder
from abhv_mc.io.address import Address, read_address
from abhv_mc.io.input_error import InputError

PUSH_INTERVAL = 5.0  # s: what the loss of this machine costs
_MANIFEST = "manifest.json"


class Remote:
    """A folder at an address, and the local one that it is kept like."""

    def __init__(self, store: Store, local: Path, lease: Lease | None = None) -> None:
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


def local_path(path: Path) -> Path | None:
    """The path itself, or what a ``file://`` address says; None for an address elsewhere."""
    found = _open(path)
    return found if isinstance(found, Path) else None


def _open(path: Path) -> Path | Store:
    """A place on this machine, or the store elsewhere."""
    address = read_address(path)
    if address is None:
        return path
    store = open_store(address)
    return Path(store.base) if store.system.type_name == "local" else store


@contextlib.contextmanager
def fetched(path: Path) -> Iterator[Path]:
    """A campaign's folder to read: ``path``, or a copy for a while of what is at an address."""
    with fetched_manifests(path, "*") as (folder, _):
        yield folder


@contextlib.contextmanager
def fetched_manifests(
    path: Path, pattern: str
) -> Iterator[tuple[Path, Callable[[str], tuple[str | None, int]] | None]]:
    """``path``, or a copy of its files that fit ``pattern``, and what else there is to say of folders there."""
    store = _open(path)
    if isinstance(store, Path):
        yield store, None
        return

    def describe(name: str) -> tuple[str | None, int]:
        one = store.below(name)
        with _explain_store_error(store.address):
            holder, _ = read_holder(one) or (None, "")
            return holder, sum(info.size or 0 for info in one.find())

    with tempfile.TemporaryDirectory(prefix="abhv-mc-") as folder:
        copy = Path(folder) / "copy"  # nobody else's folders beside it
        with _explain_store_error(store.address):
            Remote(store, copy).pull(pattern)
        yield copy, describe


@contextlib.contextmanager
def mirrored(path: Path, staging: Path | None = None) -> Iterator[Path]:
    """A campaign's folder to fly in: ``path``, or a local one whose content goes to the address as it comes.

    ``staging``: where the local one is made, by default in the system's folder for temporary files. A run whose lease
    another process has taken over is interrupted, writes nothing more to the address, and says so.
    Raises InputError where another process flies there, and StorageFullError, which names the local folder that is
    kept, where the address takes nothing in the end.
    """
    store = _open(path)
    if isinstance(store, Path):
        yield store
        return
    if staging is not None:
        staging.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix="abhv-mc-", dir=staging)) / "copy"
    folder.mkdir()
    lease = Lease(store)
    remote = Remote(store, folder, lease)
    keep, ended = False, threading.Event()
    pushing = threading.Thread(target=_push, args=(remote, ended), daemon=True)
    try:
        with _explain_store_error(store.address):
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
