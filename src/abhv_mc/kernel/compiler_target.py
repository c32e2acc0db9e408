"""What numba compiles for: LLVM's level, and this machine's processor with the whole width of its vectors.

Its settings are what it has taken, from the environment or from a file in the working folder.
"""

from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba

from abhv_mc.kernel.cache import cache_folder

# Settings of numba that change the code and that its own cache does not look at.
_SETTINGS = (
    "BOUNDSCHECK",
    "DEBUGINFO_DEFAULT",
    "DISABLE_INTEL_SVML",
    "EXTEND_VARIABLE_LIFETIMES",
    "LOOP_VECTORIZE",
    "OPT",
    "SLP_VECTORIZE",
)


def code_folder(interface: str) -> Path:
    """Folder of the code that numba makes by one of its interfaces, with its settings as they are."""
    return cache_folder(
        " ".join(
            [interface, *(f"{name}={getattr(numba.config, name, None)}" for name in _SETTINGS)]
        )
    )


def choose_target() -> None:
    """Set them for whatever numba compiles in this process from now on; public settings of numba's."""
    # LLVM's level 2: an eighth less to compile than level 3, and flights as fast.
    numba.config.OPT = type(numba.config.OPT)(2)  # type: ignore[attr-defined]
    numba.config.CACHE_LOCATOR_CLASSES = ""  # type: ignore[attr-defined]  # else CACHE_DIR may mean nothing
    features = find_features()
    if features is not None:
        numba.config.CPU_FEATURES = features  # type: ignore[attr-defined]


def find_features() -> str | None:
    """Features of this processor as LLVM writes them, with 512-bit vectors where it has them; None to leave them.

    For Intel's processors LLVM takes half of that width, which spares ordinary programs a slower clock. A flight is
    nearly all vectors: with the whole width it takes a fifth less time (``docs/explanation/performance.md``) and has
    the same bits. Who sets ``NUMBA_CPU_NAME`` or ``NUMBA_CPU_FEATURES`` has chosen for himself.
    """
    config: Any = numba.config
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None or not config.ENABLE_AVX:
        return None
    try:
        features = llvm.get_host_cpu_features()
    except RuntimeError:  # LLVM does not know this kind of processor
        return None
    return f"{features.flatten()},-prefer-256-bit" if features.get("avx512f") else None
