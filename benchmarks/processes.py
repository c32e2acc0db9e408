"""Commands as a user starts them, each with all of its processes: how long, and how much memory together."""

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

# Nobody waits for the fork server of a run, so neither its time nor that of its workers was counted. A subreaper
# (prctl's option 36, of Linux) becomes the parent of such processes, and waits for all of them.
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
INTERVAL = 0.25  # s between looks at the memory


class Usage(NamedTuple):
    """What a command took."""

    seconds: float  # by the clock on the wall
    memory_mb: float  # at the peak, of the command and the processes that it started, together


def run_command(*words: str) -> Usage:
    """Run ``abhv-mc`` with these words. Raises RuntimeError where it fails; a failed requirement is no failure."""
    start = time.perf_counter()
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "abhv_mc", *words], stdout=subprocess.DEVNULL, stderr=errors
        )
        ended = threading.Event()
        together: list[float] = []
        watch = threading.Thread(target=_watch_memory, args=(process.pid, ended, together))
        watch.start()
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        ended.set()
        watch.join()
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in {0, 1}:  # 1: a requirement of the campaign failed
            errors.seek(0)
            raise RuntimeError(f"abhv-mc {' '.join(words)}: {errors.read()[-2000:]}")
    # The kernel's peak of the largest single process misses nothing between two looks.
    largest = usage.ru_maxrss / (1e3 if sys.platform == "linux" else 1e6)
    return Usage(seconds, max([largest, *together]))


def measure_all(
    command: Sequence[str], environment: Mapping[str, str] | None = None
) -> tuple[float, float]:
    """Return the processor time (s) of a command with all its processes, and the memory (MB) of the largest.

    Raises RuntimeError if it fails; a failed requirement is no failure.
    """
    ended = subprocess.run(
        [sys.executable, "-S", "-c", _MEASURED, *command],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    code, seconds, memory = json.loads(ended.stdout)
    if code not in {0, 1}:
        raise RuntimeError(ended.stderr[-2000:])
    return seconds, memory


def _watch_memory(pid: int, ended: threading.Event, found: list[float]) -> None:
    """Append the memory of a process and its descendants, MB, until ``ended``."""
    with contextlib.suppress(psutil.NoSuchProcess):
        root = psutil.Process(pid)
        while not ended.wait(INTERVAL):
            found.append(
                sum(_own_memory(one) for one in (root, *root.children(recursive=True))) / 1e6
            )


def _own_memory(process: psutil.Process) -> int:
    """Bytes of one process, where the system tells: a page that several share counts once in their sum."""
    try:
        memory = process.memory_full_info()
    except (psutil.NoSuchProcess, psutil.AccessDenied):
        return 0
    return int(getattr(memory, "pss", memory.uss))


def measure_disk(folder: Path) -> float:
    """Size of all files in a folder, MB."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6
