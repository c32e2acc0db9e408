"""What numba compiles for: LLVM's level, and this machine's processor with the whole width of its vectors.

Its settings are what it has taken, from the environment or from a file in the working folder.
"""

import functools
import os
from pathlib import Path
from typing import Any

from abhv_mc.kernel.cache import cache_folder
from abhv_mc.kernel.prebuilt import Level, choose_level

PUBLIC = "ABHV_MC_PUBLIC_NUMBA"

# Settings of numba that change the code and that its own cache does not look at.
_SETTINGS = (
    "BOUNDSCHECK",
    "CPU_FEATURES",
    "CPU_NAME",
    "DEBUGINFO_DEFAULT",
    "DISABLE_INTEL_SVML",
    "EXTEND_VARIABLE_LIFETIMES",
    "LOOP_VECTORIZE",
    "OPT",
    "SLP_VECTORIZE",
)


def code_folder(interface: str) -> Path:
    """Folder of the code that numba makes by one of its interfaces, with its settings as they are."""
    import numba

    return cache_folder(
        " ".join(
            [interface, *(f"{name}={getattr(numba.config, name, None)}" for name in _SETTINGS)]
        )
    )


def choose_interface() -> str:
    """Return which interface of numba compiles, unless its private part is another: ``private`` or ``public``."""
    import numba

    chosen = os.environ.get(PUBLIC, "0") not in ("", "0")
    return "public" if numba.config.DISABLE_JIT or chosen else "private"  # type: ignore[attr-defined]


@functools.cache
def find_level(interface: str) -> tuple[Level | None, str]:
    """Return the level whose kernels travel with the wheel and fit, or None, and a sentence about it."""
    here = "compiled on this machine"
    if interface == "public":
        return None, f"{here}, by numba's public interface"
    if _is_chosen():
        return None, f"{here}, as numba's settings choose a processor"
    import llvmlite.binding as llvm

    try:
        return choose_level(llvm.get_host_cpu_features())
    except RuntimeError:
        return None, f"{here}, whose processor LLVM does not know"


def choose_target(interface: str) -> Level | None:
    """Set what numba compiles for in this process, by its public settings; return the level of kernels of the wheel."""
    import numba

    # LLVM's level 2: an eighth less to compile than level 3, and flights as fast.
    numba.config.OPT = type(numba.config.OPT)(2)  # type: ignore[attr-defined]
    numba.config.CACHE_LOCATOR_CLASSES = ""  # type: ignore[attr-defined]  # else CACHE_DIR may mean nothing
    level, _ = find_level(interface)
    if level is not None:
        numba.config.CPU_NAME = level.cpu  # type: ignore[attr-defined]
        numba.config.CPU_FEATURES = level.features  # type: ignore[attr-defined]
        return level
    features = find_features()
    if features is not None:
        numba.config.CPU_FEATURES = features  # type: ignore[attr-defined]
    return None


def _is_chosen() -> bool:
    """Return whether the user has chosen what numba compiles for."""
    import numba

    config: Any = numba.config
    return config.CPU_NAME is not None or config.CPU_FEATURES is not None or not config.ENABLE_AVX


def find_features() -> str | None:
    """Features of this processor as LLVM writes them, with 512-bit vectors where it has them; None to leave them.

    For Intel's processors LLVM takes half of that width, which spares ordinary programs a slower clock. A flight is
    nearly all vectors: with the whole width it takes a fifth less time (``docs/explanation/performance.md``) and has
    the same bits. Who sets ``NUMBA_CPU_NAME`` or ``NUMBA_CPU_FEATURES`` has chosen for himself.
    """
    if _is_chosen():
        return None
    import llvmlite.binding as llvm

    try:
        features = llvm.get_host_cpu_features()
    except RuntimeError:  # LLVM does not know this kind of processor
        return None
    return f"{features.flatten()},-prefer-256-bit" if features.get("avx512f") else None
