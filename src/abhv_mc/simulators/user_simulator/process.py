"""One process of a user's simulator: it is sent lines of JSON, and watched flight by flight."""

import contextlib
import functools
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

from abhv_mc.simulators.user_simulator.user_plan import UserPlan
from abhv_mc.user_code.child import describe_exit

_AHEAD = 64  # lines that are sent before the first of them is answered,
_FITS = 1 << 15  # and bytes: less than an empty pipe takes at once
_START = 600.0  # s for a Python simulator to be imported
_READ = 1 << 18
_ENDING = 2.0  # s for a process to end that has closed its standard output
_WATCH = """
import os, sys
running = set()
for line in sys.stdin:
    (running.add if int(line) > 0 else running.discard)(abs(int(line)))
for process in running:
    try:
        os.killpg(process, 9)
    except OSError:
        pass
"""
_watching = threading.Lock()


class LostFlightError(Exception):
    """The flight under way is lost, and the process with it."""


class Process:
    """It is read with a limit, so that a flight that hangs is seen."""

    def __init__(self, plan: UserPlan) -> None:
        """Raises OSError where it cannot be started, and LostFlightError where its Python file does not run."""
        self._errors: Any = tempfile.TemporaryFile()  # noqa: SIM115  it lives as long as the process
        try:
            started: Any = subprocess.Popen(  # noqa: S603  what the user's campaign names
                plan.argv,
                cwd=plan.folder,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                bufsize=0,
                start_new_session=True,  # Ctrl-C is for the process that the user sees
            )
        except OSError:
            self._errors.close()
            raise
        self._process = started
        _tell_watcher(started.pid)
        self._poll = select.poll()
        self._poll.register(self._process.stdout.fileno(), select.POLLIN)
        self._rest = b""  # of an answer
        self._ended = False
        self._read: deque[bytes] = deque()
        if plan.python and (error := self._answer(_START).get("error")) is not None:
            self.end()
            raise LostFlightError(error)

    def answers(self, lines: Sequence[bytes], limit: float) -> Iterator[dict[str, Any]]:
        """The answers to ``lines`` one by one, each within ``limit`` s of the one before. Raises LostFlightError."""
        ahead = max(1, min(_AHEAD, _FITS // max(map(len, lines), default=1)))
        for first in range(0, len(lines), ahead):
            sent = lines[first : first + ahead]
            with contextlib.suppress(BrokenPipeError):  # its end is read next
                self._process.stdin.write(b"".join(sent))
            for _ in sent:
                yield self._answer(limit)

    @property
    def number(self) -> int:
        """Of the process; 0 once it has ended."""
        return 0 if self._ended else self._process.pid

    @property
    def is_silent(self) -> bool:
        """Whether nothing was read beyond the answers asked for."""
        return not (self._read or self._rest)

    def _answer(self, limit: float) -> dict[str, Any]:
        deadline = time.monotonic() + limit
        while not self._read:
            if not self._poll.poll(max(0.0, 1e3 * (deadline - time.monotonic()))):
                self.end()
                raise LostFlightError(f"not done in {limit:g} s")
            held = os.read(self._process.stdout.fileno(), _READ)
            if not held:
                raise LostFlightError(f"its process ended: {self._describe_end()}")
            *whole, self._rest = (self._rest + held).split(b"\n")
            self._read.extend(whole)
        line = self._read.popleft()
        with contextlib.suppress(ValueError):
            if isinstance(found := json.loads(line), dict):
                return found
        self.end()  # what it answers next might be of any flight
        raise LostFlightError(f"it answered {line[:80]!r}, which is no mapping in JSON")

    def _describe_end(self) -> str:
        """How it ended, with the last line that it wrote on standard error."""
        try:
            code = self._process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self.end()
            return "it closed its standard output, and was stopped"
        self._errors.seek(max(0, self._errors.seek(0, os.SEEK_END) - 2000))
        last = self._errors.read().decode(errors="replace").strip().splitlines()[-1:]
        self.end()
        return ", ".join([describe_exit(code), *(f"'{words:.200}'" for words in last)])

    def end(self) -> None:
        """End it and what it started, whatever they do; once, for its number is then free for another process."""
        if self._ended:
            return
        self._ended = True
        for stop in (lambda: os.killpg(self._process.pid, signal.SIGKILL), self._process.kill):
            with contextlib.suppress(OSError):
                stop()
        self._process.wait()
        _tell_watcher(-self._process.pid)
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            stream.close()


def _tell_watcher(process: int) -> None:
    """That a process has begun, or (below zero) ended: where this one is killed, its pipe ends, and they with it."""
    with _watching, contextlib.suppress(OSError):
        os.write(_watcher(os.getpid()), b"%d\n" % process)


@functools.cache
def _watcher(_: int) -> int:
    """The pipe to a process that ends those of this one."""
    theirs, ours = os.pipe()
    ends = [(os.POSIX_SPAWN_DUP2, theirs, 0)]
    os.posix_spawn(
        sys.executable, [sys.executable, "-ISc", _WATCH], os.environ, file_actions=ends, setpgroup=0
    )
    os.close(theirs)
    return ours
