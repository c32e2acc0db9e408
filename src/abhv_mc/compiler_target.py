"""What numba compiles for: LLVM's level, and this machine's processor with the whole width of its vectors."""

import os

import llvmlite.binding as llvm
import numba


def choose_target() -> None:
    """Set both for whatever numba compiles in this process from now on; public settings of numba's."""
    # LLVM's level 2: an eighth less to compile than level 3, and flights as fast.
    numba.config.OPT = type(numba.config.OPT)(2)  # type: ignore[attr-defined]
    features = find_features()
    if features is not None:
        numba.config.CPU_FEATURES = features  # type: ignore[attr-defined]


def find_features() -> str | None:
    """Features of this processor as LLVM writes them, with 512-bit vectors where it has them; None to leave them.

    For Intel's processors LLVM takes half of that width, which spares ordinary programs a slower clock. A flight is
    nearly all vectors: with the whole width it takes a fifth less time (``docs/explanation/performance.md``) and has
    the same bits. Who sets ``NUMBA_CPU_NAME`` or ``NUMBA_CPU_FEATURES`` has chosen for himself.
    """
    chosen = {"NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"} & os.environ.keys()
    if chosen or not numba.config.ENABLE_AVX:  # type: ignore[attr-defined]
        return None
    try:
        features = llvm.get_host_cpu_features()
    except RuntimeError:  # LLVM does not know this kind of processor
        return None
    return f"{features.flatten()},-prefer-256-bit" if features.get("avx512f") else None
