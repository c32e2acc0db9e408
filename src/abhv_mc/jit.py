"""The only place that decorates compiled code, and where the compiled code is kept.

Rules for compiled functions (measured; the benchmark ``abhv-mc bench`` holds the result):

- strict floating point everywhere, so that flights abreast equal one flight at a time bit for bit;
- a ``scalar`` function takes and returns floats, named tuples of floats and nothing that allocates;
- a ``lanes`` function loops over the lanes of blocks that its caller allocated inside the kernel;
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
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parent
_COMPILED_LAYERS = ("jit.py", "jit_cuda.py", "numerics", "world", "vehicle", "plant", "control", "flight")


def source_hash() -> str:
    """Hash of everything that compiled code is made from: these layers' sources and numba itself."""
    digest = hashlib.sha256(f"numba {numba.__version__}".encode())
    for layer in _COMPILED_LAYERS:
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


# Without numba's reference counting (``_nrt``): nothing in here allocates, and an atomic count on each
# array of a named tuple in each lane costs three times the physics.
_INLINED: dict[str, Any] = {"forceinline": True, "error_model": "numpy", "_nrt": False}


class _InlinedLibrary(JITCodeLibrary):
    """Code that only ever becomes part of its caller's: not optimized by itself, never made machine code."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


class _InlinedCompiler(Compiler):
    """Numba's compiler as far as LLVM's intermediate code: half of the time that a cold start takes."""

    def __init__(
        self, typing_context: Any, context: Any, library: Any, args: Any, returns: Any, flags: Any, local: Any
    ) -> None:
        flags.no_compile = True
        self._code = _InlinedLibrary(context.codegen(), "inlined")
        super().__init__(typing_context, context, self._code, args, returns, flags, local)

    def _compile_core(self) -> Any:
        result = super()._compile_core()
        entry = set[Any]().remove  # numba tells functions apart by a builtin, their entry, which nobody calls
        result.target_context.insert_user_function(entry, result.fndesc, [self._code])
        return result._replace(entry_point=entry)


def scalar(function: F) -> F:
    """Compile a pure function of scalars; inlined into the lane loop that calls it, callable from Python too."""
    return cast("F", numba.njit(**_INLINED, cache=True)(function))


def lanes(function: F) -> F:
    """Compile a function that loops over lanes; inlined, so that the loop sees where its blocks live.

    Only kernels call it: it has no entry from Python.
    """
    no_entry: dict[str, Any] = {
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "pipeline_class": _InlinedCompiler,
    }
    return cast("F", numba.njit(**_INLINED, **no_entry)(function))


def kernel(function: F) -> F:
    """Compile an entry point called from Python: cached on disk, releases the interpreter's lock."""
    _KERNELS.add(function)
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy")(function))


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
