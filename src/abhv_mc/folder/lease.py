"""The lease of an address: one object that says who flies there, renewed by a thread while its holder lives.

An object store has neither locks nor renames: an object appears whole, with the store's date. Two processes that start
within a second of each other on one address are told apart by what the store holds a moment later.
"""

import _thread
import json
import os
import platform
import sys
import threading
import time
import uuid

import pyarrow as pa

from abhv_mc.folder.store import Store
from abhv_mc.io.input_error import InputError

NAME = ".lock"
LEASE = 60.0  # s after which a lease that nobody renews is nobody's
RENEWAL = 15.0  # s between renewals: a copy may take longer than the lease
_SETTLE = 1.0  # s until a store shows everyone the same


class Lease:
    """What says that this process flies at an address."""

    def __init__(self, store: Store) -> None:
        self._store, self._token = store, uuid.uuid4().hex
        self._ended = threading.Event()
        self.lost: InputError | None = None  # who has taken it over: nothing is written from then on

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
            self._store.delete(NAME)

    def _renew_until_the_end(self) -> None:
        while not self._ended.wait(RENEWAL):
            try:
                self.renew()
            except InputError as error:
                print(f"{error}\nThis run stops, and writes nothing more there.", file=sys.stderr, flush=True)
                _thread.interrupt_main()
                return
            except (OSError, pa.ArrowException):  # perhaps it goes next time
                continue

    def _write(self) -> None:
        who = {"pid": os.getpid(), "host": platform.node(), "token": self._token}
        self._store.write(NAME, json.dumps(who).encode())

    def _is_abandoned(self) -> bool:
        """Whether nobody has renewed the lease for long, by the store's clock alone: two hosts' may differ by hours."""
        probe = f"{NAME}.{self._token}"
        self._store.write(probe, b"")
        try:
            held, now = self._store.ages(NAME, probe)
        finally:
            self._store.delete(probe)
        return held is not None and now is not None and (now - held).total_seconds() > LEASE

    def _check(self, abandoned: bool = False) -> None:
        found = read_holder(self._store)
        if found is not None and found[1] != self._token and not abandoned:
            wish = f"its end (or {LEASE:g} s after it was killed), or another address"
            raise InputError(str(self._store.address), f"a campaign that {found[0]} is flying", wish)


def read_holder(store: Store) -> tuple[str, str] | None:
    """Who flies at an address, or was killed at it within the lease, in words, and its mark; None for nobody."""
    try:
        held = json.loads(store.read(NAME))
        return f"process {held['pid']} on {held['host']}", held["token"]
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError):
        return "another process", ""
