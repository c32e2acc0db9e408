"""Which code computes rows in this process: one hash of the source that it has imported, and of its compiler.

Whatever flies, draws, judges or merges may shape a row, so every package counts but those that only show (``_SHOWN``).
A process that lives through an edit of its source is still the old code: the hash is of the source when this module was
imported, and modules that are imported later are held against it. What compiled code is kept under is another, smaller
hash (:mod:`abhv_mc.kernel.cache`): an edit of a table in ``execution`` must not compile the kernels anew.
"""

import functools
import hashlib
import os
import platform
import sys
import threading
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

_PACKAGE = Path(__file__).parent
_SHOWN = ("cli", "report", "topics")


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
    files = (file for file in package.rglob("*.py") if file.relative_to(package).parts[0] not in _SHOWN)
    return {_module_name(package, file): hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(files)}


def _module_name(package: Path, file: Path) -> str:
    parts = [package.name, *file.relative_to(package).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


_source = hash_source(_PACKAGE)
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
    words = [f"{name} {version(name)}" for name in ("numba", "llvmlite")]
    words += [f"{name} {digest}" for name, digest in modules]
    return hashlib.sha256("\n".join(words).encode()).hexdigest()[:16]


def this_flyer() -> Flyer:
    """This process."""
    return Flyer(code_hash(), *_describe_machine(), os.getpid())


@functools.cache
def _describe_machine() -> tuple[str, str, str, str]:
    import llvmlite.binding as llvm

    names = ("numpy", "scipy", "numba", "llvmlite")
    versions = ", ".join([f"python {platform.python_version()}", *(f"{name} {version(name)}" for name in names)])
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
