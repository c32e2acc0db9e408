"""The only place that decorates compiled code, and where the compiled code is kept.

Rules for compiled functions (measured; the benchmark ``abhv-mc bench`` holds the result):

- strict floating point everywhere, so that flights abreast equal one flight at a time bit for bit;
- a ``scalar`` function takes and returns floats, named tuples of floats and nothing that allocates;
- a ``lanes`` function loops over the lanes of blocks that its caller allocated inside the kernel;
- arrays that a function takes do not overlap where it writes to one: the compiler relies on that;
- no libm call inside a lane loop: use :mod:`abhv_mc.numerics.lane_math`;
- data (tables, gains, references) are arguments, never globals: numba freezes globals silently.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import event

from abhv_mc.jit_compiler import InlinedCompiler, KernelCompiler, Scalar

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parent
_COMPILED_FILES = ("jit.py", "jit_compiler.py", "jit_cuda.py")
_COMPILED_LAYERS = ("numerics", "world", "vehicle", "plant", "control", "flight")


def source_hash() -> str:
    """Hash of everything that compiled code is made from: its sources and numba itself."""
    digest = hashlib.sha256(f"numba {numba.__version__}".encode())
    for layer in (*_COMPILED_FILES, *_COMPILED_LAYERS):
        path = _PACKAGE / layer
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.relative_to(_PACKAGE).as_posix().encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Folder of the compiled code for exactly this source; numba's own key covers the CPU."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base) / "abhv-mc" / source_hash()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # no home, or a read-only one
        folder = Path(tempfile.gettempdir()) / f"abhv-mc-{os.getuid()}" / source_hash()
        folder.mkdir(parents=True, exist_ok=True)
    return folder


_KERNELS: set[Callable[..., Any]] = set()

# numba decides on the cache's place when it decorates, so this comes before any decorator.
numba.config.CACHE_DIR = str(cache_folder())  # type: ignore[attr-defined]
# LLVM's level 2: a tenth less to compile than level 3, and flights as fast.
numba.config.OPT = type(numba.config.OPT)(2)  # type: ignore[attr-defined]


# Without numba's reference counting: nothing in here allocates, and an atomic count on each array of a named tuple in
# each lane costs three times the physics.
_UNCOUNTED: dict[str, Any] = {"_nrt": False}
_INLINED: dict[str, Any] = {"forceinline": True, "error_model": "numpy", **_UNCOUNTED}
_NO_ENTRY: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_CALLED: dict[str, Any] = {"cache": True, "no_cfunc_wrapper": True, "pipeline_class": KernelCompiler}


def scalar(function: F) -> F:
    """Compile a pure function of scalars; inlined into the lane loop that calls it, callable from Python too."""
    return cast("F", Scalar(function, {**_INLINED, **_NO_ENTRY}, numba.njit(**_INLINED, **_CALLED)))


def lanes(function: F) -> F:
    """Compile a function that loops over lanes; inlined, so that the loop sees where its blocks live.

    Only kernels call it: it has no entry from Python.
    """
    return cast("F", numba.njit(**_INLINED, **_NO_ENTRY, pipeline_class=InlinedCompiler)(function))


def routine(function: F) -> F:
    """Compile a function that kernels call in many places: not inlined, and without an entry from Python."""
    options = {**_INLINED, "forceinline": False}
    return cast("F", numba.njit(**options, **_NO_ENTRY, pipeline_class=InlinedCompiler)(function))


def kernel(function: F) -> F:
    """Compile an entry point called from Python: cached on disk, releases the interpreter's lock."""
    _KERNELS.add(function)
    return cast("F", numba.njit(nogil=True, error_model="numpy", **_CALLED)(function))


def bare_kernel(function: F) -> F:
    """As :func:`kernel`, for an entry point that allocates nothing: without reference counting."""
    _KERNELS.add(function)
    return cast("F", numba.njit(nogil=True, error_model="numpy", **_UNCOUNTED, **_CALLED)(function))


class _FirstCompile(event.Listener):
    def __init__(self, called: Callable[[], None]) -> None:
        self._called: Callable[[], None] | None = called

    def on_start(self, started: Any) -> None:
        if self._called is not None and started.data["dispatcher"].py_func in _KERNELS:
            called, self._called = self._called, None
            called()

    def on_end(self, ended: Any) -> None:
        pass


def on_first_compile(called: Callable[[], None]) -> None:
    """Have ``called`` called once, at the moment when numba sets out to compile a kernel that its cache lacks."""
    event.register("numba:compile", _FirstCompile(called))
