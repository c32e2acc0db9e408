"""Disk cache of compiled code, and precompiled kernels in the wheel.

The cache has a folder for each source version and compiler. The wheel has kernels for several
interpreters and levels of x86-64.

A build is an archive of numba's cache with a manifest. Builds are trusted like the package's code;
the SHA-256 hash in the manifest detects damaged archives.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import shutil
import stat
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from abhv_mc.cache_root import NO_LOCKS, cache_root
from abhv_mc.version import ROOT

_PACKAGE = Path(__file__).parent
# Files outside the package whose numbers are constants of compiled code.
_NUMBERS = [ROOT / f"abhv_mc/flights/{name}.py" for name in ("statistic", "timing")]


def source_hash() -> str:
    """Return a machine-independent hash of the kernel's source and numba's version."""
    digest = hashlib.sha256(f"numba {version('numba')} llvmlite {version('llvmlite')}".encode())
    for file in sorted(_PACKAGE.rglob("*.py")):
        digest.update(file.relative_to(_PACKAGE).as_posix().encode())
        digest.update(file.read_bytes())
    for file in _NUMBERS:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


# The hash is computed once per process, so an edit of the source affects only later processes.
_SOURCE = source_hash()


def source_unchanged() -> bool:
    """Return whether the source is unchanged since this process imported it."""
    return source_hash() == _SOURCE


def cache_folder(compiler: str) -> Path:
    """Return the cache folder for kernels that are compiled with ``compiler``.

    ``compiler`` is a string that describes the compiler's interface and settings. A group shares
    the folder if its members can write all files; otherwise each member has a folder.
    """
    name = hashlib.sha256(f"{_SOURCE} {compiler}".encode()).hexdigest()[:16]
    folder = cache_root() / name
    is_shared = folder.parent.stat().st_mode & stat.S_IWGRP
    paths = (folder, *folder.rglob("*")) if is_shared and folder.exists() else ()
    if not all(os.access(path, os.R_OK | os.W_OK) for path in paths):
        folder = folder.with_name(f"{name}-{os.getuid()}")
    folder.mkdir(mode=0o770 if is_shared else 0o700, exist_ok=True)
    return folder


@contextlib.contextmanager
def compilation_lock(
    folder: str | Path | None,
    name: str,
    waiting: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
) -> Iterator[None]:
    """Hold a lock while the function ``name`` is compiled or loaded from ``folder``.

    ``folder`` may be a parent of numba's cache folder; None means that nothing is cached. If
    several processes need a function that is not cached, one process compiles it while the others
    wait, inside the context that ``waiting`` returns, and load the result. The operating system
    releases the lock when the process ends. Cache files that do not match their stored hashes are
    deleted, because numba would execute them.

    On a file system without locks, several processes may compile the same function. The cache stays
    valid: numba writes each file under a temporary name and renames it, and ``KernelCache`` gives
    each file a unique name.
    """
    if folder is None:
        yield
        return
    folder = Path(folder)
    with (folder / f"{name}.lock").open("a") as lock:
        if not is_noted(folder, name):
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                with waiting():
                    fcntl.flock(lock, fcntl.LOCK_EX)
            except OSError as error:
                if error.errno not in NO_LOCKS:
                    raise
            if not is_noted(folder, name):
                for file in _files_of(folder, name):
                    file.unlink(missing_ok=True)
        yield
        if not is_noted(folder, name):
            _note(folder, name).write_text(_digest(folder, name))


def _files_of(folder: Path, name: str) -> list[Path]:
    """Return numba's cache files for a function: [MODULE.]NAME-LINE... with suffix nbi or nbc."""
    return sorted(file for file in folder.rglob("*.nb[ic]") if f".{name}-" in f".{file.name}")


def _note(folder: Path, name: str) -> Path:
    return folder / f"{name}.sha256"


def _digest(folder: Path, name: str) -> str:
    files = _files_of(folder, name)
    return "".join(
        f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files
    )


def is_noted(folder: Path, name: str) -> bool:
    """Return whether numba's files for a function in the folder match their stored hashes."""
    try:
        return bool(noted := _note(folder, name).read_text()) and noted == _digest(folder, name)
    except OSError:  # There is no stored hash, or another process is deleting the files.
        return False


# Folder of builds in the wheel; a source checkout has no builds.
FOLDER = Path(__file__).parents[1] / "prebuilt"
_COMPILERS = ("numba", "llvmlite")
_AVX2 = ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")


class Level(NamedTuple):
    """Microarchitecture level of x86-64, described in LLVM's terms."""

    cpu: str
    features: str  # changes to LLVM's features for the level, to use 512-bit vectors
    needed: tuple[str, ...]  # features that the processor must have

    def lacks(self, processor: Mapping[str, bool]) -> list[str]:
        """Return the features that a processor lacks."""
        return [name for name in self.needed if not processor.get(name)]


LEVELS = (  # levels in order of decreasing preference
    Level(
        "x86-64-v4",
        "-prefer-256-bit",
        (*_AVX2, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"),
    ),
    Level("x86-64-v3", "", _AVX2),
)


def name_interpreter() -> str:
    """Return the tag of this interpreter, such as ``cp311``."""
    return f"cp{sys.version_info[0]}{sys.version_info[1]}{sys.abiflags}"


def choose_level(processor: Mapping[str, bool]) -> tuple[Level | None, str]:
    """Return the best level that has a usable build (or None), and an explanation."""
    reason = f"this installation has no kernels for {name_interpreter()}"
    for level in LEVELS:
        archive = _archive(level)
        if not archive.is_file():
            continue
        if lacks := level.lacks(processor):
            reason = f"the wheel's kernels require a processor with {', '.join(lacks)}"
        elif misfit := _find_misfit(archive):
            reason = misfit
        else:
            return level, f"for {level.cpu}, from the wheel"
    return None, f"compiled on this machine, because {reason}"


def _archive(level: Level) -> Path:
    return FOLDER / f"{level.cpu}-{name_interpreter()}.zip"


def _find_misfit(archive: Path) -> str:
    """Return the reason why a build cannot be used; '' if it can be used."""
    try:
        manifest = json.loads(archive.with_suffix(".json").read_text("utf-8"))
        for name in _COMPILERS:
            if manifest[name] != version(name):
                return (
                    f"the wheel's kernels were compiled with {name} {manifest[name]}, which the "
                    "extra 'kernels' of the wheel installs"
                )
        if manifest["source"] != source_hash():
            return "the wheel's kernels were compiled from a different source"
        if manifest["sha256"] != hashlib.sha256(archive.read_bytes()).hexdigest():
            return f"{archive.name} is damaged"
    except (OSError, ValueError, KeyError):
        return f"{archive.with_suffix('.json').name} is missing or damaged"
    return ""


def unpack(level: Level, folder: Path) -> None:
    """Unpack the kernels of a level into the cache folder, if the folder is empty."""
    if any(folder.iterdir()):
        return
    fresh = Path(tempfile.mkdtemp(prefix="unpacked-", dir=folder.parent))
    try:
        with zipfile.ZipFile(_archive(level)) as archive:
            archive.extractall(fresh)
        fresh.rename(folder)
    except OSError:  # Another process created the folder first, or the disk is full.
        shutil.rmtree(fresh, ignore_errors=True)


def pack(level: Level, cache: Path, into: Path) -> None:
    """Write the build of a level from a numba cache folder with only this level's files."""
    archive = into / _archive(level).name
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as content:
        for file in sorted(cache.rglob("*")):
            if file.is_file() and file.suffix != ".lock":
                name = zipfile.ZipInfo(os.fspath(file.relative_to(cache)))
                name.external_attr = 0o600 << 16
                content.writestr(name, file.read_bytes(), zipfile.ZIP_DEFLATED)
    manifest = {
        "source": source_hash(),
        **{name: version(name) for name in _COMPILERS},
        "python": name_interpreter(),
        "level": level.cpu,
        "sha256": hashlib.sha256(archive.read_bytes()).hexdigest(),
    }
    archive.with_suffix(".json").write_text(json.dumps(manifest, indent=1) + "\n")
