"""Time and memory of commands with all their processes."""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import psutil

# No process waits for the fork server of a run, so that its time and that of its workers would not
# be counted. A subreaper (option 36 of prctl on Linux) becomes the parent of such processes and
# waits for all of them.
_MEASURED = """
import ctypes, json, os, resource, subprocess, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
try:
    while True:
        os.wait()
except ChildProcessError:
    pass
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([code, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3]))
"""
INTERVAL = 0.25  # s between measurements of the memory


class Usage(NamedTuple):
    """Time and memory of a command."""

    seconds: float  # wall time
    memory_mb: float  # peak of the command and all its processes together


def run_command(*arguments: str) -> Usage:
    """Run ``abhv-mc``. Raise RuntimeError if it fails; a failed requirement is accepted."""
    start = time.perf_counter()
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "abhv_mc", *arguments], stdout=subprocess.DEVNULL, stderr=errors
        )
        ended = threading.Event()
        totals: list[float] = []
        watch = threading.Thread(target=_watch_memory, args=(process.pid, ended, totals))
        watch.start()
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        ended.set()
        watch.join()
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in {0, 1}:  # 1: a requirement of the campaign failed
            errors.seek(0)
            raise RuntimeError(f"abhv-mc {' '.join(arguments)}: {errors.read()[-2000:]}")
    # The operating system's peak of the largest process includes times between measurements.
    largest = usage.ru_maxrss / (1e3 if sys.platform == "linux" else 1e6)
    return Usage(seconds, max([largest, *totals]))


def measure_all(
    command: Sequence[str],
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
) -> tuple[float, float]:
    """Return the processor time of a command, s, and the memory of its largest process, MB.

    The time includes all its processes. The command starts in ``folder``. Raise RuntimeError if
    it fails; a failed requirement is accepted.
    """
    ended = subprocess.run(
        [sys.executable, "-S", "-c", _MEASURED, *command],
        cwd=folder,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    code, seconds, memory = json.loads(ended.stdout)
    if code not in {0, 1}:
        raise RuntimeError(ended.stderr[-2000:])
    return seconds, memory


def _watch_memory(pid: int, ended: threading.Event, totals: list[float]) -> None:
    """Append the memory of a process and its descendants, MB, until ``ended`` is set."""
    with contextlib.suppress(psutil.NoSuchProcess):
        root = psutil.Process(pid)
        while not ended.wait(INTERVAL):
            totals.append(
                sum(_own_memory(process) for process in (root, *root.children(recursive=True)))
                / 1e6
            )


def _own_memory(process: psutil.Process) -> int:
    """Return the memory of a process in bytes; shared pages count once in a sum if possible."""
    try:
        memory = process.memory_full_info()
    except (psutil.NoSuchProcess, psutil.AccessDenied):
        return 0
    return int(getattr(memory, "pss", memory.uss))


def measure_disk(folder: Path) -> float:
    """Return the size of all files in a folder, MB."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6
