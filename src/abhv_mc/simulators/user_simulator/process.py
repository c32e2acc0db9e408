"""One process of a user's simulator: it is sent lines of JSON, and watched flight by flight."""

import contextlib
import json
import os
import select
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from typing import Any

from abhv_mc.simulators.user_simulator.user_plan import UserPlan
from abhv_mc.user_code.child import describe_exit

_AHEAD = 64  # lines that are sent before the first of them is answered
_START = 600.0  # s for a Python simulator to be imported
_READ = 1 << 18


class LostFlightError(Exception):
    """The flight under way is lost, and the process with it."""


class Process:
    """Its pipes are never blocked on, so that a flight that hangs is seen."""

    def __init__(self, plan: UserPlan) -> None:
        """Raises OSError where it cannot be started, and LostFlightError where its Python file does not run."""
        self._errors: Any = tempfile.TemporaryFile()  # noqa: SIM115  it lives as long as the process
        try:
            self._process = subprocess.Popen(  # noqa: S603  what the user's campaign names
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
        if self._process.stdin is None or self._process.stdout is None:
            raise OSError("no pipes")
        self._to, self._from = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._to, False)
        self._poll = select.poll()
        self._poll.register(self._from, select.POLLIN)
        self._rest, self._waiting = b"", b""  # of an answer, and lines that are not sent yet
        if plan.python:
            (answer,) = self.answers([], 1, _START)
            if (error := json.loads(answer).get("error")) is not None:
                self.end()
                raise LostFlightError(error)

    def answers(self, lines: list[bytes], number: int, limit: float) -> Iterator[bytes]:
        """The answers to ``lines`` one by one, each within ``limit`` s of the one before. Raises LostFlightError."""
        sent = done = 0
        deadline = time.monotonic() + limit
        while done < number:
            if sent - done <= _AHEAD // 2 and sent < len(lines):
                self._waiting += b"".join(lines[sent : done + _AHEAD])
                sent = min(done + _AHEAD, len(lines))
            self._send()
            ready = self._poll.poll(max(0.0, 1e3 * (deadline - time.monotonic())))
            if not ready:
                self.end()
                raise LostFlightError(f"not done in {limit:g} s")
            if not any(descriptor == self._from for descriptor, _ in ready):
                continue
            held = os.read(self._from, _READ)
            if not held:
                raise LostFlightError(f"its process ended: {self._describe_end()}")
            *whole, self._rest = (self._rest + held).split(b"\n")
            if whole:
                deadline = time.monotonic() + limit
            for answer in whole:
                done += 1
                yield answer
                if done == number:
                    break

    def _send(self) -> None:
        """As much of what waits as the pipe takes; the rest when it takes more."""
        if self._waiting:
            try:
                self._waiting = self._waiting[os.write(self._to, self._waiting) :]
            except BlockingIOError:
                pass
            except BrokenPipeError:
                self._waiting = b""  # its end is read next
        if self._waiting:
            self._poll.register(self._to, select.POLLOUT)
        else:
            with contextlib.suppress(KeyError):
                self._poll.unregister(self._to)

    def _describe_end(self) -> str:
        """How it ended, with the last line that it wrote on standard error."""
        code = self._process.wait()
        self._errors.seek(max(0, self._errors.seek(0, os.SEEK_END) - 2000))
        last = self._errors.read().decode(errors="replace").strip().splitlines()[-1:]
        self.end()
        return ", ".join([describe_exit(code), *(f"'{words:.200}'" for words in last)])

    def end(self) -> None:
        """End it and what it started, whatever they do."""
        for stop in (lambda: os.killpg(self._process.pid, signal.SIGKILL), self._process.kill):
            with contextlib.suppress(OSError):
                stop()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            if stream is not None:
                stream.close()
