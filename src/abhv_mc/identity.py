"""Where rows come from: one hash of the source that this process has imported and of its compiler; commit and machine.

Whatever flies, draws, judges or merges may shape a row, so every package counts but those that only show (``_SHOWN``),
and those beside ``abhv_mc`` that register executors, stores, control laws or blocks (:mod:`abhv_mc.entry_points`).
A process that lives through an edit of its source is still the old code: the hash is of the source when this module was
imported, and modules that are imported later are held against it. What compiled code is kept under is another, smaller
hash (:mod:`abhv_mc.kernel.cache`): an edit of a table in ``execution`` must not compile the kernels anew.
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

import abhv_mc
from abhv_mc.entry_points import find_packages

_PACKAGE = Path(__file__).parent
_SHOWN = ("cli", "report", "topics")
_COMPILERS = ("numba", "llvmlite")
_LIBRARIES = ("numpy", *_COMPILERS, "scipy", "pyarrow", "joblib")


class Flyer(NamedTuple):
    """Who flew a block."""

    code: str  # of code_hash()
    versions: str
    processor: str
    features: str  # of the processor, hashed
    host: str
    process: int

    @property
    def name(self) -> str:
        """As messages call it."""
        return f"{self.host}, process {self.process}"


def hash_source(package: Path) -> dict[str, str]:
    """SHA-256 of each module of a package that may shape a row, by its name."""
    if package.is_file():  # a module alone
        return {package.stem: hashlib.sha256(package.read_bytes()).hexdigest()}
    files = (
        file for file in package.rglob("*.py") if file.relative_to(package).parts[0] not in _SHOWN
    )
    return {
        _module_name(package, file): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(files)
    }


def _module_name(package: Path, file: Path) -> str:
    parts = [package.name, *file.relative_to(package).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _hash_registered() -> dict[str, str]:
    """SHA-256 of each module of the packages that register what may shape a row, by its name."""
    hashes: dict[str, str] = {}
    for name in find_packages():
        spec = find_spec(name)
        if spec is not None and spec.origin is not None:
            file = Path(spec.origin)
            hashes |= hash_source(file.parent if file.name == "__init__.py" else file)
    return hashes


_source = hash_source(_PACKAGE) | _hash_registered()
_known: set[str] = set()  # modules whose source has been held against it
_lock = threading.Lock()


def code_hash() -> str:
    """The same wherever the same code flies. After an import of edited source: one that no other process has."""
    with _lock:
        for name in [name for name in list(sys.modules) if name in _source and name not in _known]:
            file = getattr(sys.modules[name], "__file__", None)
            try:
                found = hashlib.sha256(Path(file or "").read_bytes()).hexdigest()
            except OSError:
                found = "deleted"
            if found != _source[name]:
                _source[name] = f"{found}, beside older modules"
            _known.add(name)
        return _join_hashes(tuple(_source.items()))


@functools.lru_cache(1)
def _join_hashes(modules: tuple[tuple[str, str], ...]) -> str:
    words = [f"{name} {version(name)}" for name in _COMPILERS]
    words += [f"{name} {digest}" for name, digest in modules]
    return hashlib.sha256("\n".join(words).encode()).hexdigest()[:16]


def this_flyer() -> Flyer:
    """This process."""
    return Flyer(code_hash(), *_describe_machine(), os.getpid())


@functools.cache
def _describe_machine() -> tuple[str, str, str, str]:
    import llvmlite.binding as llvm

    held = find_versions()
    versions = ", ".join(
        f"{name} {held[name]}" for name in ("python", "numpy", "scipy", *_COMPILERS)
    )
    try:
        features = llvm.get_host_cpu_features().flatten()
    except RuntimeError:  # LLVM does not know this kind of processor
        features = "unknown"
    features = hashlib.sha256(f"{llvm.get_host_cpu_name()} {features}".encode()).hexdigest()[:16]
    return versions, find_processor(), features, platform.node()


def find_processor() -> str:
    """The processor's name."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"


def find_versions() -> dict[str, str]:
    """Versions of the program, Python and the libraries that results rest on."""
    return {
        "abhv_mc": abhv_mc.__version__,
        "python": platform.python_version(),
        **{name: version(name) for name in _LIBRARIES},
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
        return commit + (
            "+" if _git(root, "status", "--porcelain", "--untracked-files=no", "--", "src") else ""
        )
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
    """Cores that this process may use: those it may run on, or as many as a container's quota keeps busy."""
    from joblib import cpu_count

    return int(cpu_count())
