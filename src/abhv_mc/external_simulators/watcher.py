"""Watcher process that ends simulators and deletes their folders if abhv-mc is killed."""

import contextlib
import functools
import os
import sys
import threading

# The program reads "+NAME" and "-NAME"; a name is a process group's ID or a folder's path.
_PROGRAM = """
import os, shutil, sys, time
names = set()
for line in sys.stdin:
    (names.add if line[0] == "+" else names.discard)(line[1:-1])
folders = {name for name in names if not name.isdigit()}
for process in names - folders:
    try:
        os.killpg(int(process), 9)
    except OSError:
        pass
for _ in range(20):
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)
    if not any(map(os.path.exists, folders)):
        break
    time.sleep(0.1)
"""
_lock = threading.Lock()


def watch(name: int | str) -> None:
    """Register a process group to end or a folder to delete if this process dies."""
    _tell(f"+{name}\n")


def unwatch(name: int | str) -> None:
    """Undo :func:`watch` once the process has ended or the folder is deleted."""
    _tell(f"-{name}\n")


def _tell(line: str) -> None:
    with _lock, contextlib.suppress(OSError):
        os.write(_pipe(os.getpid()), os.fsencode(line))


@functools.cache
def _pipe(_: int) -> int:
    """Return the pipe to this process's watcher; start the watcher on first use."""
    theirs, ours = os.pipe()
    ends = [(os.POSIX_SPAWN_DUP2, theirs, 0)]
    os.posix_spawn(
        sys.executable,
        [sys.executable, "-ISc", _PROGRAM],
        os.environ,
        file_actions=ends,
        setpgroup=0,
    )
    os.close(theirs)
    return ours
