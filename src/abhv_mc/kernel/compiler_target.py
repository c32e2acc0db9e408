"""Compilation target of numba: LLVM's optimization level, processor and vector width.

Settings that the user gives to numba, in the environment or in a file in the working folder, take
precedence.
"""

import functools
import os
from pathlib import Path
from typing import Any

from abhv_mc.kernel.cache import cache_folder
from abhv_mc.kernel.prebuilt import Level, choose_level

PUBLIC = "ABHV_MC_PUBLIC_NUMBA"

# settings of numba that change the code but are ignored by numba's own cache
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
    """Return the cache folder for code compiled through one of numba's interfaces."""
    import numba

    return cache_folder(
        " ".join(
            [interface, *(f"{name}={getattr(numba.config, name, None)}" for name in _SETTINGS)]
        )
    )


def choose_interface() -> str:
    """Return which numba interface is used for compilation: ``private`` or ``public``."""
    import numba

    chosen = os.environ.get(PUBLIC, "0") not in ("", "0")
    return "public" if numba.config.DISABLE_JIT or chosen else "private"  # type: ignore[attr-defined]


@functools.cache
def find_level(interface: str) -> tuple[Level | None, str]:
    """Return the level of the wheel's usable kernels (or None), and an explanation."""
    origin = "compiled on this machine"
    if interface == "public":
        return None, f"{origin}, by numba's public interface"
    if _is_chosen():
        return None, f"{origin}, as numba's settings choose a processor"
    import llvmlite.binding as llvm

    try:
        return choose_level(llvm.get_host_cpu_features())
    except RuntimeError:
        return None, f"{origin}, whose processor LLVM does not know"


def choose_target(interface: str) -> Level | None:
    """Set numba's target; return the level of the wheel's kernels if they are used."""
    import numba

    # LLVM's optimization level 2 compiles an eighth faster than level 3, and flights run equally
    # fast.
    numba.config.OPT = type(numba.config.OPT)(2)  # type: ignore[attr-defined]
    numba.config.CACHE_LOCATOR_CLASSES = ""  # type: ignore[attr-defined]  # else CACHE_DIR may be ignored
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
    """Return whether the user has selected numba's target."""
    import numba

    config: Any = numba.config
    return config.CPU_NAME is not None or config.CPU_FEATURES is not None or not config.ENABLE_AVX


def find_features() -> str | None:
    """Return this processor's features in LLVM's format, with 512-bit vectors if available.

    By default LLVM uses only half of that width for Intel processors, because wide vectors reduce
    the clock rate. A flight consists mostly of vector code: with the full width it takes a fifth
    less time (``docs/explanation/performance.md``), with the same bits. Return None if the
    processor is unknown, or if the user has set ``NUMBA_CPU_NAME`` or ``NUMBA_CPU_FEATURES``.
    """
    if _is_chosen():
        return None
    import llvmlite.binding as llvm

    try:
        features = llvm.get_host_cpu_features()
    except RuntimeError:  # LLVM does not know this kind of processor.
        return None
    return f"{features.flatten()},-prefer-256-bit" if features.get("avx512f") else None
