"""Origin of results: hash of the imported source and compilers, commit and machine.

The hash covers the subpackages of abhv_mc, except those that only present results (``_SHOWN``). It
also covers the packages that register simulators, executors, stores, control laws or blocks
(:mod:`abhv_mc.entry_points`). If the source is edited while a process runs, the process still
executes the old code. The hash is therefore computed when this module is imported, and the source
of modules that are imported later is compared with it. The cache of compiled code uses a different
hash (:mod:`abhv_mc_vehicle.kernel.cache`).
"""

import functools
import hashlib
import os
import platform
import subprocess
import sys
import threading
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from abhv_mc.entry_points import find_packages
from abhv_mc.version import ROOT, __version__

_PACKAGE = ROOT / "abhv_mc"
_SHOWN = ("cli", "report", "topics")
_COMPILERS = ("numba", "llvmlite")
_LIBRARIES = ("numpy", *_COMPILERS, "scipy", "pyarrow", "joblib")


class Flyer(NamedTuple):
    """Process that computed a block of flights, with its code and machine."""

    code: str  # result of code_hash()
    versions: str
    processor: str
    features: str  # hash of the processor's instruction set features
    host: str
    process: int

    @property
    def name(self) -> str:
        """Host and process number as text for messages."""
        return f"{self.host}, process {self.process}"


def hash_source(package: Path) -> dict[str, str]:
    """Return the SHA-256 of each module that may change results, by module name."""
    if package.is_file():  # a single module
        return {package.stem: hashlib.sha256(package.read_bytes()).hexdigest()}
    depth = len(package.parts)
    return {
        _module_name((package.name, *file.parts[depth:-1], file.stem)): hashlib.sha256(
            file.read_bytes()
        ).hexdigest()
        for file in sorted(package.rglob("*.py"))
        if file.parts[depth] not in _SHOWN
    }


def _module_name(parts: tuple[str, ...]) -> str:
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _hash_registered() -> dict[str, str]:
    """Return the SHA-256 of each module of the registered packages, by module name."""
    hashes: dict[str, str] = {}
    for name in find_packages():
        spec = find_spec(name)
        if spec is not None and spec.origin is not None:
            file = Path(spec.origin)
            hashes |= hash_source(file.parent if file.name == "__init__.py" else file)
    return hashes


_source = hash_source(_PACKAGE) | _hash_registered()
_known: set[str] = set()  # modules whose source has been compared with the hash
_lock = threading.Lock()


def code_hash() -> str:
    """Return the hash of the code and of the compiler versions.

    If the process imported source that was edited after its start, its hash differs from the hash
    of every other process.
    """
    with _lock:
        for name in [name for name in list(sys.modules) if name in _source and name not in _known]:
            file = getattr(sys.modules[name], "__file__", None)
            try:
                digest = hashlib.sha256(Path(file or "").read_bytes()).hexdigest()
            except OSError:
                digest = "deleted"
            if digest != _source[name]:
                _source[name] = f"{digest}, beside older modules"
            _known.add(name)
        return _join_hashes(tuple(_source.items()))


@functools.lru_cache(1)
def _join_hashes(modules: tuple[tuple[str, str], ...]) -> str:
    lines = [f"{name} {version(name)}" for name in _COMPILERS]
    lines += [f"{name} {digest}" for name, digest in modules]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def this_flyer() -> Flyer:
    """Return the code, versions and machine of this process."""
    return Flyer(code_hash(), *_describe_machine(), os.getpid())


@functools.cache
def _describe_machine() -> tuple[str, str, str, str]:
    import llvmlite.binding as llvm

    installed = find_versions()
    versions = ", ".join(
        f"{name} {installed[name]}" for name in ("python", "numpy", "scipy", *_COMPILERS)
    )
    try:
        features = llvm.get_host_cpu_features().flatten()
    except RuntimeError:  # LLVM does not know this kind of processor
        features = "unknown"
    features = hashlib.sha256(f"{llvm.get_host_cpu_name()} {features}".encode()).hexdigest()[:16]
    return versions, find_processor(), features, platform.node()


def find_processor() -> str:
    """Return the model name of the processor."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"


@functools.cache
def find_versions() -> dict[str, str]:
    """Return the versions of abhv_mc, Python and the libraries that determine results."""
    return {
        "abhv_mc": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in _LIBRARIES},
    }


def find_commit() -> str | None:
    """Return the Git commit of the program's source, or None if it is not in a Git repository.

    A ``+`` is appended if tracked source files have uncommitted changes.
    """
    root = ROOT.parent
    if not (root / ".git").exists():
        return None
    try:
        commit = _git(root, "rev-parse", "HEAD")
        return commit + (
            "+" if _git(root, "status", "--porcelain", "--untracked-files=no", "--", "src") else ""
        )
    except (OSError, subprocess.SubprocessError):
        return None


def _git(root: Path, *arguments: str) -> str:
    command = ["git", "-C", str(root), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)  # noqa: S603
    return done.stdout.strip()


def find_machine() -> dict[str, Any]:
    """Return the machine properties on which results and run times may depend."""
    return {
        "system": f"{platform.system()} {platform.release()}",
        "architecture": platform.machine(),
        "processor": find_processor(),
        "cores": count_cores(),
        "byte_order": sys.byteorder,
    }


def count_cores() -> int:
    """Return the number of cores available to this process, within a container's quota."""
    from joblib import cpu_count

    return int(cpu_count())
