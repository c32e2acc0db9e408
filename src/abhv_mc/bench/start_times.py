"""What starting costs, and the memory of a campaign: each in a process of its own."""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from abhv_mc.shipped import shipped_campaigns


@dataclass(frozen=True)
class Start:
    """Seconds and megabytes."""

    cold: float  # process start to the end of the first flight, with nothing compiled
    warm: float  # the same from the cache
    importing: float  # of the package, inside a running Python
    peak_memory: float  # of the default campaign with its report


def measure_start(repetitions: int, runs: int | None = None) -> Start:
    """Medians of ``repetitions`` starts, of one cold start, and the default campaign's memory (with ``runs`` flights).

    Raises subprocess.CalledProcessError where a process fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        fresh = {"XDG_CACHE_HOME": str(Path(folder) / "cache")}
        cold, _ = _run(_FIRST_FLIGHT, fresh)
        warm = [_run(_FIRST_FLIGHT, fresh)[0] for _ in range(repetitions)]
        imports = [float(_run(_IMPORT, {})[1]) for _ in range(repetitions)]
        campaign = [str(shipped_campaigns() / "s_manoeuvre.yaml"), "-o", str(Path(folder) / "campaign")]
        size = [] if runs is None else ["--runs", str(runs)]
        memory = _peak_memory(["-m", "abhv_mc", "run", *campaign, *size])
    return Start(cold, median(warm), median(imports), memory)


_FIRST_FLIGHT = ["-m", "abhv_mc", "fly", "s_manoeuvre", "--controllers", "tlc"]
_IMPORT = ["-c", "import time; t = time.perf_counter(); import abhv_mc; print(time.perf_counter() - t)"]


def _run(arguments: list[str], changes: dict[str, str]) -> tuple[float, str]:
    """Wall time, s, and standard output of a Python process."""
    searched = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PYTHONSAFEPATH": "1"}  # not the working folder
    environment = {**os.environ, **searched, **changes}
    start = time.perf_counter()
    done = subprocess.run(  # noqa: S603
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, check=True
    )
    return time.perf_counter() - start, done.stdout


# Linux counts a parent's memory as its child's until the child has replaced itself: the parent must be a small one.
_WATCH = (
    "import resource, subprocess, sys\n"
    "code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode\n"
    "print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
)


def _peak_memory(arguments: list[str]) -> float:
    """Largest resident memory, MB, of a Python process; exit code 1 is a campaign that failed a requirement."""
    _, said = _run(["-S", "-c", _WATCH, sys.executable, *arguments], {})
    code, size = map(int, said.split())
    if code not in (0, 1):
        raise subprocess.CalledProcessError(code, arguments)
    return size / (1e6 if sys.platform == "darwin" else 1e3)
