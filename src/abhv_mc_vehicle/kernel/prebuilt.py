"""Precompiled kernels in the wheel, for several interpreters and levels of x86-64.

A build is an archive of numba's cache with a manifest. Builds are trusted like the package's code;
the SHA-256 hash in the manifest detects damaged archives.
"""

import hashlib
import json
import os
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from abhv_mc_vehicle.kernel.cache import source_hash

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
        manifest = json.loads(archive.with_suffix(".json").read_text(encoding="utf-8"))
        for name in _COMPILERS:
            if manifest[name] != version(name):
                return f"the wheel's kernels were compiled with {name} {manifest[name]}"
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
