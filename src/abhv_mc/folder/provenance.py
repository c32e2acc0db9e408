"""Where results come from: program, libraries, commit and machine."""

import os
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import abhv_mc
from abhv_mc.identity import find_processor

_LIBRARIES = ("numpy", "numba", "llvmlite", "scipy", "pyarrow", "joblib")


def find_versions() -> dict[str, str]:
    """Versions of the program, Python and the libraries that results rest on."""
    return {
        "abhv_mc": abhv_mc.__version__,
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in _LIBRARIES},
    }


def find_compiler() -> str:
    """Which interface of numba compiled the flight: ``private`` or ``public``."""
    from abhv_mc.kernel.jit import compiler  # which loads numba

    return compiler()


def find_commit() -> str | None:
    """Commit of the checkout that the program runs from, with ``+`` when files differ from it; None outside one."""
    root = Path(abhv_mc.__file__).parents[2]
    if not (root / ".git").exists():
        return None
    try:
        commit = _git(root, "rev-parse", "HEAD")
        return commit + ("+" if _git(root, "status", "--porcelain", "--untracked-files=no", "--", "src") else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _git(root: Path, *words: str) -> str:
    command = ["git", "-C", str(root), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)  # noqa: S603
    return done.stdout.strip()


def find_machine() -> dict[str, Any]:
    """The machine, as far as results and times may depend on it."""
    return {
        "system": f"{platform.system()} {platform.release()}",
        "architecture": platform.machine(),
        "processor": find_processor(),
        "cores": count_cores(),
        "byte_order": sys.byteorder,
    }


def count_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
