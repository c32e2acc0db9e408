"""Compilation target of numba: LLVM's optimization level, processor and vector width.

Numba settings in environment variables or in a ``.numba_config.yaml`` file in the working folder
take precedence.
"""

import functools
import os
from pathlib import Path
from typing import Any

from abhv_mc_vehicle.kernel.cache import Level, cache_folder, choose_level

PUBLIC = "ABHV_MC_PUBLIC_NUMBA"

# Settings of numba that affect the machine code but not the choice of file in numba's own cache.
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
    """Return the cache folder for code compiled with the given interface of numba."""
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
    """Return the x86-64 level of the wheel's usable kernels (or None), and an explanation."""
    origin = "compiled on this machine"
    if interface == "public":
        return None, f"{origin}, by numba's public interface"
    if _is_chosen():
        return None, f"{origin}, because numba's settings select a processor"
    import llvmlite.binding as llvm

    try:
        return choose_level(llvm.get_host_cpu_features())
    except RuntimeError:
        return None, f"{origin}, because LLVM does not recognize the processor"


def choose_target(interface: str) -> Level | None:
    """Set numba's target; return the level of the wheel's kernels if they are used."""
    import numba

    # Compared with level 3, LLVM's optimization level 2 takes an eighth less time to compile, and
    # the compiled code is equally fast.
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
    """Return whether numba's settings select a processor or its features."""
    import numba

    config: Any = numba.config
    return config.CPU_NAME is not None or config.CPU_FEATURES is not None or not config.ENABLE_AVX


def find_features() -> str | None:
    """Return this processor's features in LLVM's format, with 512-bit vectors if available.

    By default LLVM uses 256-bit vectors on Intel processors, because wider vectors reduce the clock
    rate. Flights consist mostly of vector code and run in a fifth less time with 512-bit vectors
    (``docs/explanation/performance.md``); the results are bit-identical. Return None if the
    processor is unknown, or if the user has set ``NUMBA_CPU_NAME`` or ``NUMBA_CPU_FEATURES``.
    """
    if _is_chosen():
        return None
    import llvmlite.binding as llvm

    try:
        features = llvm.get_host_cpu_features()
    except RuntimeError:  # LLVM does not recognize the processor.
        return None
    return f"{features.flatten()},-prefer-256-bit" if features.get("avx512f") else None
