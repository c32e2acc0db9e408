"""Objects in a folder of object storage, and the lease of the process that writes.

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
import sys
import threading
import time
import uuid
from typing import Any

import pyarrow as pa
from pyarrow import fs as pyarrow_fs

from abhv_mc.io.address import Address
from abhv_mc.io.input_error import InputError

_PATIENCE = 20.0  # time limit in s for replies of Google Cloud Storage
_OBJECT_STORES = ("s3", "gcs", "abfs")
LEASE_NAME = ".lock"
LEASE = 60.0  # time in s after which a lease expires unless renewed
RENEWAL = 15.0  # interval in s between renewals of a lease
_SETTLE = 1.0  # time in s until all readers of a store see the same content


class Objects:
    """Objects in a folder; methods raise OSError or errors of pyarrow if the store fails."""

    def __init__(self, address: Address, system: Any, base: str) -> None:
        self.address, self.system, self.base = address, system, base

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
        problem = f"the address '{address}' cannot be used ({address.explain(error)})"
        expected = "s3://bucket/folder, gs://bucket/folder or a path"
        raise InputError("address", problem, expected) from None
    return Objects(address, system, base.rstrip("/"))


class Lease:
    """Exclusive right of this process to write to an address."""

    def __init__(self, store: Objects) -> None:
        self._store, self._token = store, uuid.uuid4().hex
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
                print(
                    f"{error}\nThis run stops and writes nothing more to this address.",
                    file=sys.stderr,
                    flush=True,
                )
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
            problem = f"{holder[0]} is running a campaign at this address"
            expected = (
                f"the process to end (or {LEASE:g} s to pass after it was killed), or another "
                "address"
            )
            raise InputError(str(self._store.address), problem, expected)


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
