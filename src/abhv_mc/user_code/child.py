"""A process or a thread beside this one for a user's code that may crash, hang, or read what it does not declare.

One is kept for all calls; it ends with this process, and is replaced where it is lost.
"""

import atexit
import contextlib
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
_ROOT = Path(__file__).parents[2]
_START = "import sys; sys.path.append(sys.argv[2]); from abhv_mc.user_code.child import serve; serve(int(sys.argv[1]))"
_may_run = False  # whether this process is one that may be lost
_lock = threading.RLock()
_child: "_Child | None" = None


class LostError(Exception):
    """The process ended, or did not answer in time (``hung``)."""

    def __init__(self, words: str, hung: bool, process: int) -> None:
        super().__init__(words, hung, process)
        self.words, self.hung, self.process = words, hung, process


def allow_here() -> None:
    """Say that this process may be lost: native code of a user's runs in it from now on."""
    global _may_run  # noqa: PLW0603  what this process is for
    _may_run = True


def may_run_here() -> bool:
    """Whether native code of a user's may run in this process: a worker's or a child's, never the launching one."""
    return _may_run


def check_may_run() -> None:
    """Raise RuntimeError where native code of a user's would be loaded into another process."""
    if not _may_run:
        raise RuntimeError("native code of a user's is run by workers and the child alone")


def in_child(function: Callable[..., T], *arguments: Any, limit: float | None = None) -> T:
    """What a module's function gives or raises, called in the child. Raises LostError, after ``limit`` s at the latest.

    In a process that may be lost itself it is called right here.
    """
    global _child  # noqa: PLW0603  one for all calls
    if _may_run:
        return function(*arguments)
    with _lock:
        if _child is None or not _child.is_usable():
            _child = _Child()
        try:
            answer, failed = _child.call(function, arguments, limit)
        except BaseException:
            _child.end()
            _child = None
            raise
    if failed:
        raise answer
    return answer


@contextlib.contextmanager
def called_beside(function: Callable[..., Any], *arguments: Any) -> Iterator[None]:
    """Call a module's function in a process beside this one, for what it leaves behind; it ends with the context."""
    child = _Child()
    caller = threading.Thread(target=child.leave_to, args=(function, arguments), daemon=True)
    caller.start()
    try:
        yield
    finally:
        child.kill()  # with which the call ends, before its pipe is closed
        caller.join()
        child.end()


def describe_exit(code: int | None) -> str:
    """How a process ended, in words."""
    return (
        f"killed by {signal.Signals(-code).name}"
        if code is not None and code < 0
        else f"exit code {code}"
    )


class _Child:
    def __init__(self) -> None:
        self._pid = os.getpid()
        self._connection, theirs = multiprocessing.Pipe()
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603  Python itself
                [sys.executable, "-P", "-c", _START, str(theirs.fileno()), str(_ROOT)],
                stdin=subprocess.PIPE,  # whose end it waits for
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # Ctrl-C is for the process that the user sees
            )
        atexit.register(self.end)

    def is_usable(self) -> bool:
        return self._pid == os.getpid() and self._process.poll() is None

    def leave_to(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        with contextlib.suppress(OSError, LostError):
            self.call(function, arguments, None)

    def call(
        self, function: Callable[..., Any], arguments: tuple[Any, ...], limit: float | None
    ) -> tuple[Any, bool]:
        try:
            self._connection.send((function, arguments))
            if not self._connection.poll(limit):
                raise LostError(f"it was not done in {limit:g} s", True, self._process.pid)
            return self._connection.recv()
        except (EOFError, ConnectionError):
            words = f"its process ended: {describe_exit(self._process.wait())}"
            raise LostError(words, False, self._process.pid) from None

    def kill(self) -> None:
        with contextlib.suppress(OSError):
            self._process.kill()

    def end(self) -> None:
        if self._pid != os.getpid():  # a fork's copy
            return
        self.kill()
        self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._connection.close()
        atexit.unregister(self.end)


def serve(descriptor: int) -> None:
    """What the child does: answer calls until the parent hangs up."""
    allow_here()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with Connection(descriptor) as connection:
        while True:
            try:
                function, arguments = connection.recv()
            except (EOFError, OSError):
                return
            try:
                answer: tuple[Any, bool] = function(*arguments), False
            except BaseException as error:
                answer = error, True
            try:
                connection.send(answer)
            except (pickle.PicklingError, TypeError, AttributeError):
                connection.send((RuntimeError(f"{type(answer[0]).__name__}: {answer[0]}"), True))


def _end_with_parent() -> None:
    while os.read(0, 1024):
        pass
    os._exit(1)


def run_in_thread(work: Callable[[], T], limit: float | None = None) -> T:
    """What ``work`` gives or raises, in a thread that can be left behind; this one hears of Ctrl-C meanwhile.

    Raises TimeoutError after ``limit`` s.
    """
    done: list[T] = []
    failed: list[BaseException] = []

    def run() -> None:
        try:
            done.append(work())
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(limit)
    if failed:
        raise failed[0]
    if not done:
        raise TimeoutError
    return done[0]
