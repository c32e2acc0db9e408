"""Process of a custom simulator, which exchanges JSON lines within time limits."""

import atexit
import contextlib
import fcntl
import json
import math
import os
import select
import signal
import subprocess
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

from abhv_mc.custom_code.child import describe_exit
from abhv_mc.external_simulators.user_plan import UserPlan
from abhv_mc.external_simulators.working_folder import (
    delete_working_folder,
    make_working_folder,
    unwatch,
    watch,
)
from abhv_mc.io.messages import notify

_AHEAD = 64  # maximum number of requests sent ahead of replies
_FITS = 1 << 15  # maximum number of bytes sent ahead, below the capacity of a pipe
_READ = 1 << 18
_ENDING = 2.0  # time in s for a process to end after closing standard output
_LOOK = 1.0  # interval in s between checks of a computing process
_EXCERPT = 2000  # number of bytes kept from the start and from the end of the standard error output
_MOST_ERRORS = 1 << 20  # maximum size in bytes of the standard error output on disk
# Linux does not run a script that is open for writing, so processes start one by one.
_starting = threading.Lock()


class LostFlightError(Exception):
    """Error raised if a flight and its simulator process failed."""


class OutOfStepError(Exception):
    """Error raised if a process wrote an unrequested line, so that replies may not match."""


class Process:
    """Running simulator process with its own working folder."""

    def __init__(self, plan: UserPlan) -> None:
        """Start the process. Raise OSError or LostFlightError if the start fails."""
        self._errors: Any = tempfile.TemporaryFile()  # noqa: SIM115  the process writes to the file
        fcntl.fcntl(
            self._errors, fcntl.F_SETFL, os.O_APPEND
        )  # The file may be truncated while it is written.
        try:
            with _starting:
                self.folder = make_working_folder(plan)
                try:
                    started: Any = subprocess.Popen(  # noqa: S603  program named in the user's campaign
                        plan.argv(self.folder),
                        cwd=self.folder,
                        stdin=subprocess.PIPE,
                        stdout=subprocess.PIPE,
                        stderr=self._errors,
                        bufsize=0,
                        start_new_session=True,  # Ctrl-C must not reach the simulator.
                    )
                except OSError:
                    delete_working_folder(self.folder)
                    raise
        except BaseException:
            self._errors.close()
            raise
        self._process = started
        self._reply_size = plan.reply_size
        watch(started.pid)
        self._poll = select.poll()
        self._poll.register(self._process.stdout.fileno(), select.POLLIN)
        self._rest = b""  # incomplete reply
        self._ended = False
        self._read: deque[bytes] = deque()
        self._has_written = False
        self.has_timed_out = False
        self._excerpt = b""
        self._next_flight = int.from_bytes(os.urandom(4), "big")
        self.flights = 0  # number of completed flights
        # number of replies, since the last check, that do not repeat the string of their request
        self.unproven = 0
        self.first_time = 0.0  # time in s from the start to the first reply
        self.longest = 0.0  # longest time in s to any later reply
        if plan.python:
            error = self._answer(plan.start_limit, "loaded").get("error")
            if error is not None:
                self.end()
                raise LostFlightError(self._without_folder(error))

    def answers(
        self, requests: Sequence[bytes], limit: float, *, start: float = 0.0, ahead: bool = False
    ) -> Iterator[dict[str, Any]]:
        """Yield the replies to ``requests``, each within ``limit`` s after the previous one.

        ``start`` is the additional time in s for the first reply of the process. With ``ahead``,
        several requests are sent before their replies arrive. Raise LostFlightError or
        OutOfStepError.
        """
        size = max(1, min(_AHEAD, _FITS // (16 + max(map(len, requests), default=1))))
        step = size if ahead else 1
        for first in range(0, len(requests), step):
            batch = requests[first : first + step]
            texts = [self._make_text() for _ in batch]
            self.send(
                b"".join(
                    b'%s"%s"}\n' % (request, text.encode())
                    for request, text in zip(batch, texts, strict=True)
                )
            )
            for text in texts:
                answer = self._answer(limit) if self._read else self._time_answer(limit, start)
                self.flights += 1
                echo = answer.pop("flight", None)
                if echo is None:
                    self.unproven += 1
                elif echo != text:
                    raise OutOfStepError
                yield answer

    @property
    def number(self) -> int:
        """Process ID, or 0 after the end of the process."""
        return 0 if self._ended else self._process.pid

    def _time_answer(self, limit: float, start: float) -> dict[str, Any]:
        begun = time.monotonic()
        answer = self._answer(limit + (0.0 if self.flights else start), notice=limit)
        seconds = time.monotonic() - begun
        if self.flights:
            self.longest = max(self.longest, seconds)
        else:
            self.first_time = seconds
        return answer

    def _make_text(self) -> str:
        """Return an arbitrary string, which is unique among the requests of this process."""
        self._next_flight += 1
        return f"{self._next_flight * 2654435761 & 0xFFFFFFFF:08x}"

    def is_silent(self, seconds: float, is_last: bool = False) -> bool:
        """Return whether the process writes nothing further for ``seconds``.

        If ``is_last`` is true, no request follows, and the input is closed so that the process ends
        sooner.
        """
        if is_last:
            self._process.stdin.close()
        if self._ended or self._read or self._rest:
            return self._ended
        if not self._poll.poll(1e3 * seconds):
            return True
        return not os.read(self._process.stdout.fileno(), _READ)  # empty if the process has ended

    def has_ended(self) -> bool:
        """Return whether the process has ended."""
        return self._ended or self._process.poll() is not None

    def _answer(
        self, limit: float, verb: str = "finished", notice: float = math.inf
    ) -> dict[str, Any]:
        """Read a reply within ``limit`` s; print a notice after ``notice`` s of waiting."""
        line = self.read(limit, verb, notice)
        with contextlib.suppress(ValueError):
            if isinstance(answer := json.loads(line), dict):
                return answer
        self.end()  # Later replies cannot be assigned to flights.
        text = line[:80].decode(errors="replace")
        problem = f"it replied '{text}', which is not a JSON object"
        raise LostFlightError(f"{problem} (messages belong on standard error)")

    def send(self, requests: bytes) -> None:
        """Write requests. A process that has ended is detected when its reply is read."""
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(requests)

    def read(self, limit: float, verb: str = "finished", notice: float = math.inf) -> bytes:
        """Return the next reply. Raise LostFlightError if it takes longer than ``limit`` s.

        Print a notice after ``notice`` s of waiting.
        """
        if not self._read:
            self._read_replies(limit, verb, notice)
        return self._read.popleft()

    def _split(self, content: bytes) -> list[bytes]:
        """Return the replies in ``content``; the last one is incomplete."""
        if not (size := self._reply_size):
            return content.split(b"\n")
        return [content[i : i + size] for i in range(0, len(content) + 1, size)]

    def _read_replies(self, limit: float, verb: str, notice: float) -> None:
        begun, reply_limit = time.monotonic(), notice
        deadline, notice = begun + limit, begun + notice
        while not self._read:
            left = max(0.0, deadline - time.monotonic())
            if self._poll.poll(1e3 * min(left, _LOOK)):
                if not (content := os.read(self._process.stdout.fileno(), _READ)):
                    raise LostFlightError(f"its process ended: {self._describe_end()}")
                *lines, self._rest = self._split(self._rest + content)
                self._read.extend(lines)
                if not self._has_written:  # The start ends with the first output.
                    self._has_written, limit = True, min(limit, reply_limit)
                    deadline = min(deadline, time.monotonic() + limit)
                if left or self._read:
                    continue
            if os.fstat(self._errors.fileno()).st_size > _MOST_ERRORS:
                self._gather_errors()
            if left <= _LOOK:
                self.has_timed_out = True
                self.end()
                raise LostFlightError(f"not {verb} within {limit:g} s{self._describe_silence()}")
            if notice < time.monotonic():
                notice = math.inf
                self._gather_errors()
                message = f"still waiting for the first reply, for {left:.0f} s more at most"
                message = ", ".join([f"{message} (start_limit)", *self._quote_last_error()])
                notify(f"simulator: {message}")
            # Children may keep the standard output open.
            if self._process.poll() is not None and not self._poll.poll(0):
                raise LostFlightError(f"its process ended: {self._describe_end()}")

    def _describe_silence(self) -> str:
        """Return the last error line of the process, or a possible cause of its silence."""
        if error := self._quote_last_error():
            return f"; the last line on standard error is {error[0]}"
        if self._has_written:
            return ""
        return "; it wrote no output: does it flush standard output after each reply?"

    def _quote_last_error(self) -> list[str]:
        """Return the last line on standard error in quotation marks, if any."""
        last = self._excerpt.decode(errors="replace").strip().splitlines()[-1:]
        return [f"'{self._without_folder(text):.200}'" for text in last]

    def _describe_end(self) -> str:
        """Return a description of how the process ended, including its last line on stderr."""
        try:
            code = self._process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self.end()
            return "it closed its standard output and was stopped"
        self.end()
        return ", ".join([describe_exit(code), *self._quote_last_error()])

    def _without_folder(self, text: str) -> str:
        """Return the text with its file names made relative to the folder of the process."""
        return text.replace(f"{self.folder}{os.sep}", "")

    def take_errors(self) -> str:
        """Return an excerpt of the standard error output since the last call."""
        if not self._ended:
            self._gather_errors()
        excerpt, self._excerpt = self._excerpt, b""
        return self._without_folder(excerpt.decode(errors="replace"))

    def _gather_errors(self) -> None:
        """Move the beginning and end of the standard error output to the excerpt."""
        file = self._errors.fileno()
        if not (size := os.fstat(file).st_size):
            return
        new = os.pread(file, 2 * _EXCERPT, 0)
        if size > 2 * _EXCERPT:
            new = new[:_EXCERPT] + b"\n...\n" + os.pread(file, _EXCERPT, size - _EXCERPT)
        os.ftruncate(file, 0)
        text = self._excerpt + new
        is_short = len(text) <= 3 * _EXCERPT
        self._excerpt = text if is_short else text[:_EXCERPT] + b"\n...\n" + text[-_EXCERPT:]

    def end(self) -> None:
        """End the process group and delete its folder.

        Later calls have no effect, because the system may reuse the ID of the process.
        """
        if self._ended:
            return
        self._ended = True
        for stop in (lambda: os.killpg(self._process.pid, signal.SIGKILL), self._process.kill):
            with contextlib.suppress(OSError):
                stop()
        self._process.wait()
        self._gather_errors()
        unwatch(self._process.pid)
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            stream.close()
        delete_working_folder(self.folder)


class StoppedError(Exception):
    """Error raised if the campaign is stopped during a flight."""


class ProcessPool:
    """Thread-safe pool of simulator processes."""

    def __init__(self) -> None:
        self.idle: dict[object, list[Process]] = {}
        self.all: set[Process] = set()
        self.lock = threading.Lock()
        self.closed = False
        self.owner = os.getpid()

    def take(self, plan: UserPlan) -> Process:
        """Return an idle process or a new process for a plan."""
        with self.lock:
            if idle := self.idle.get(plan.process):
                return idle.pop()
        process = Process(plan)
        with self.lock:
            self.all.add(process)
        if self.closed:
            process.end()
        return process

    def give_back(self, plan: UserPlan, process: Process) -> None:
        """Return an idle process to the pool for later flights."""
        with self.lock:
            self.idle.setdefault(plan.process, []).append(process)

    def end(self, process: Process) -> None:
        """End a process and remove it from the pool."""
        process.end()
        with self.lock:
            self.all.discard(process)

    def close(self) -> None:
        """End all processes; their current flights fail."""
        self.closed = True
        if self.owner == os.getpid():
            for process in list(self.all):
                process.end()


_pool = ProcessPool()


def current_pool() -> ProcessPool:
    """Return the process pool for new flights."""
    return _pool


def end_processes() -> None:
    """End all idle and busy processes; later flights start new processes."""
    global _pool
    ended, _pool = _pool, ProcessPool()
    ended.close()


atexit.register(end_processes)
