"""Separate processes and threads for custom code that may crash, hang or read files.

One child process serves all calls. The child ends with its parent process and is replaced if it
dies.
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
from concurrent.futures import Future
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from abhv_mc.version import ROOT

T = TypeVar("T")
_START = (
    "import sys; sys.path.append(sys.argv[2]); from abhv_mc.custom_code.child import serve; "
    "serve(int(sys.argv[1]))"
)
_may_run = False  # whether this process may run code that can crash it
_lock = threading.RLock()
_child: "_Child | None" = None


class LostError(Exception):
    """Error raised if the child process ends, or exceeds its time limit (``hung`` is true)."""

    def __init__(self, reason: str, hung: bool, process: int) -> None:
        super().__init__(reason, hung, process)
        self.words, self.hung, self.process = reason, hung, process


def allow_here() -> None:
    """Allow this process to run custom native code."""
    global _may_run  # noqa: PLW0603  marks the role of this process
    _may_run = True


def may_run_here() -> bool:
    """Return whether custom native code may run in this process (a worker or a child)."""
    return _may_run


def check_may_run() -> None:
    """Raise RuntimeError if custom native code must not run in this process."""
    if not _may_run:
        raise RuntimeError("custom native code runs only in workers and child processes")


def in_child(function: Callable[..., T], *arguments: Any, limit: float | None = None) -> T:
    """Call a module-level function in the child process; return its result or raise its error.

    A worker or child process calls the function directly. Raise LostError if the child ends or
    takes longer than ``limit`` s.
    """
    global _child  # noqa: PLW0603  one child for all calls
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
    """Run a module-level function in another process while the context is open."""
    child = _Child()
    caller = threading.Thread(target=child.leave_to, args=(function, arguments), daemon=True)
    caller.start()
    try:
        yield
    finally:
        child.kill()  # The call must end before its pipe is closed.
        caller.join()
        child.end()


def describe_exit(code: int | None) -> str:
    """Return a description of how a process ended."""
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
            self._process = subprocess.Popen(  # noqa: S603  runs Python itself
                [sys.executable, "-P", "-c", _START, str(theirs.fileno()), str(ROOT)],
                stdin=subprocess.PIPE,  # The child exits when this pipe closes.
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # Ctrl-C must not reach the child.
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
                raise LostError(f"it did not finish within {limit:g} s", True, self._process.pid)
            return self._connection.recv()
        except (EOFError, ConnectionError):
            reason = f"its process ended: {describe_exit(self._process.wait())}"
            raise LostError(reason, False, self._process.pid) from None

    def kill(self) -> None:
        with contextlib.suppress(OSError):
            self._process.kill()

    def end(self) -> None:
        if self._pid != os.getpid():  # A forked process must not end its parent's child.
            return
        self.kill()
        self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._connection.close()
        atexit.unregister(self.end)


def serve(descriptor: int) -> None:
    """Execute calls in the child process until the parent closes the connection."""
    allow_here()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with Connection(descriptor) as connection:
        while True:
            try:
                function, arguments = connection.recv()
            except (EOFError, OSError):
                return
            try:
                answer = function(*arguments), False
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
    """Run ``work`` in a thread that can be abandoned; return its result or raise its error.

    The calling thread can still be interrupted with Ctrl-C. Raise TimeoutError after ``limit`` s.
    """
    future = Future[T]()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return future.result(limit)
