"""A folder at any address that pyarrow.fs knows (s3://, gs://, hdfs://): its objects, and the lease of the process that
writes there.

An object store has neither locks nor renames: an object appears whole, with the store's date. So one object says who
flies there, renewed by a thread while its holder lives. Two processes that start within a second of each other on one
address are told apart by what the store holds a moment later.
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

_PATIENCE = 20.0  # s for a store of Google's to answer
_OBJECT_STORES = ("s3", "gcs", "abfs")
LEASE_NAME = ".lock"
LEASE = 60.0  # s after which a lease that nobody renews is nobody's
RENEWAL = 15.0  # s between renewals: a copy may take longer than the lease
_SETTLE = 1.0  # s until a store shows everyone the same


class Objects:
    """The objects below a folder. All methods raise OSError or pyarrow's errors where the store does not answer."""

    def __init__(self, address: Address, system: Any, base: str) -> None:
        self.address, self.system, self.base = address, system, base

    def below(self, name: str) -> "Objects":
        """A folder in this one."""
        return Objects(self.address, self.system, f"{self.base}/{name}".rstrip("/"))

    def find(self) -> list[Any]:
        """What pyarrow says of all objects, those of folders below among them."""
        selector = pyarrow_fs.FileSelector(self.base, allow_not_found=True, recursive=True)
        found: list[Any] = self.system.get_file_info(selector)
        return found

    def read(self, name: str) -> bytes:
        """An object's content. Raises FileNotFoundError."""
        with self.system.open_input_stream(f"{self.base}/{name}") as stream:
            return bytes(stream.read())

    def write(self, name: str, content: bytes) -> None:
        """Put an object, in place of another one of its name."""
        place = f"{self.base}/{name}"
        if self.system.type_name not in _OBJECT_STORES:
            self.system.create_dir(place.rpartition("/")[0], recursive=True)
        with self.system.open_output_stream(place) as stream:
            stream.write(content)

    def delete(self, name: str) -> None:
        """Delete an object, where there is one."""
        with contextlib.suppress(FileNotFoundError):
            self.system.delete_file(f"{self.base}/{name}")

    def ages(self, *names: str) -> list[Any]:
        """When each object was written, by the store's clock; None for one that there is not."""
        return [
            info.mtime
            for info in self.system.get_file_info([f"{self.base}/{name}" for name in names])
        ]


def open_objects(address: Address) -> Objects:
    """The folder at an address. Raises InputError for what is none."""
    uri = address.uri()
    if uri.startswith(("gs:", "gcs:")) and "retry_limit_seconds=" not in uri:
        uri += (
            f"{'&' if '?' in uri else '?'}retry_limit_seconds={_PATIENCE:g}"  # 900 s in the library
        )
    try:
        system, base = pyarrow_fs.FileSystem.from_uri(uri)
    except (pa.ArrowException, OSError, ValueError) as error:
        found = f"'{address}' ({address.explain(error)})"
        raise InputError(
            "address", found, "s3://bucket/folder, gs://bucket/folder or a path"
        ) from None
    return Objects(address, system, base.rstrip("/"))


class Lease:
    """What says that this process flies at an address."""

    def __init__(self, store: Objects) -> None:
        self._store, self._token = store, uuid.uuid4().hex
        self._ended = threading.Event()
        self.lost: InputError | None = (
            None  # who has taken it over: nothing is written from then on
        )

    def take(self) -> None:
        """Take the lease and renew it until it is dropped; a run whose lease another process takes is interrupted.

        Raises InputError, which names the holder, where another process has renewed it lately.
        """
        self._check(abandoned=self._is_abandoned())
        self._write()
        time.sleep(_SETTLE)
        self._check()
        threading.Thread(target=self._renew_until_the_end, daemon=True).start()

    def renew(self) -> None:
        """Say that this process still flies here. Raises InputError where another one has taken over."""
        try:
            self._check()
        except InputError as error:
            self.lost = error
        if self.lost is not None:
            raise self.lost
        self._write()

    def stop(self) -> None:
        """Renew it no more."""
        self._ended.set()

    def drop(self) -> None:
        """Let others fly here."""
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
                    f"{error}\nThis run stops, and writes nothing more there.",
                    file=sys.stderr,
                    flush=True,
                )
                _thread.interrupt_main()
                return
            except (OSError, pa.ArrowException):  # perhaps it goes next time
                continue

    def _write(self) -> None:
        who = {"pid": os.getpid(), "host": platform.node(), "token": self._token}
        self._store.write(LEASE_NAME, json.dumps(who).encode())

    def _is_abandoned(self) -> bool:
        """Whether nobody has renewed the lease for long, by the store's clock alone: two hosts' may differ by hours."""
        probe = f"{LEASE_NAME}.{self._token}"
        self._store.write(probe, b"")
        try:
            held, now = self._store.ages(LEASE_NAME, probe)
        finally:
            self._store.delete(probe)
        return held is not None and now is not None and (now - held).total_seconds() > LEASE

    def _check(self, abandoned: bool = False) -> None:
        found = read_holder(self._store)
        if found is not None and found[1] != self._token and not abandoned:
            wish = f"its end (or {LEASE:g} s after it was killed), or another address"
            raise InputError(
                str(self._store.address), f"a campaign that {found[0]} is flying", wish
            )


def read_holder(store: Objects) -> tuple[str, str] | None:
    """Who flies at an address, or was killed at it within the lease, in words, and its mark; None for nobody."""
    try:
        held = json.loads(store.read(LEASE_NAME))
        return f"process {held['pid']} on {held['host']}", held["token"]
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError):
        return "another process", ""
