"""The only place that decorates compiled code.

Rules for compiled functions (measured; the benchmark ``abhv-mc bench`` holds the result):

- strict floating point everywhere, so that flights abreast equal one flight at a time bit for bit;
- a ``scalar`` function takes and returns floats, named tuples of floats and nothing that allocates;
- a ``lanes`` function loops over the lanes of blocks that its caller allocated;
- arrays that a function takes do not overlap where it writes to one: the compiler relies on that;
- no libm call inside a lane loop: use :mod:`abhv_mc.numerics.lane_math`;
- data (tables, gains, references) are arguments, never globals: numba freezes globals silently;
- a ``standalone`` kernel returns nothing and allocates nothing: what it works in is an argument.

Decorating costs nothing: numba is loaded when something has to be compiled, or loaded from numba's own cache. The
machine code of standalone kernels is found without it.
"""

import functools
import hashlib
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from abhv_mc.code_cache import cache_folder, file_hash, one_at_a_time, source_unchanged
from abhv_mc.machine_code import Kinds, describe, describe_processor, flatten, keep_code, load_code, recall_code

F = TypeVar("F", bound=Callable[..., Any])

# Plain Python throughout, as numba itself does it: for counting operations, and for the GPU's simulator.
_PLAIN = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")

_lock = threading.RLock()
_announcements: list[Callable[[], None]] = []
_teachers: list[Callable[[], None]] = []
_kernels: set[Callable[..., Any]] = set()


class Compiled:
    """A function that becomes numba's when Python calls it or a compiled function names it."""

    def __init__(self, function: Callable[..., Any], role: str) -> None:
        functools.update_wrapper(self, function)
        self.py_func = function
        self._role = role
        self._dispatcher: Any = None

    @property
    def dispatcher(self) -> Any:
        """What numba makes of the function."""
        if self._dispatcher is None:
            with _lock:
                self._dispatcher = self._dispatcher or load_compiler().MAKERS[self._role](self.py_func)
        return self._dispatcher

    @property
    def _numba_type_(self) -> Any:  # numba asks this of a value that it does not know
        return self.dispatcher._numba_type_

    def __call__(self, *arguments: Any) -> Any:
        return self.dispatcher(*arguments)

    def __getattr__(self, name: str) -> Any:
        """What a numba function has besides: ``signatures``, ``stats`` ..."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.dispatcher, name)


class StandaloneKernel:
    """A kernel whose machine code is kept on disk, found and called without numba."""

    def __init__(self, function: Callable[..., Any]) -> None:
        functools.update_wrapper(self, function)
        self.py_func = function
        self._content = file_hash(Path(function.__code__.co_filename))
        self._loaded: dict[Kinds, Callable[[list[Any]], None]] = {}

    @property
    def signatures(self) -> list[str]:
        """The kinds of arguments that it has been called with."""
        return list(map(describe, self._loaded))

    def __call__(self, *arguments: Any) -> None:
        kinds, flat = flatten(arguments)
        if kinds not in self._loaded:
            self.load(*arguments)
        self._loaded[kinds](flat)

    def load(self, *arguments: Any) -> None:
        """Load or compile the code for arguments of these kinds. Of several processes one compiles."""
        kinds, _ = flatten(arguments)
        with _lock:
            if kinds in self._loaded:
                return
            made_for = "; ".join((self._source(), describe(kinds), describe_processor()))
            name = hashlib.sha256(made_for.encode()).hexdigest()[:32]
            file = cache_folder() / "kernels" / f"{self.py_func.__name__}-{name}"
            code = recall_code(file, made_for)
            if code is None:
                announce_compiling()
                with one_at_a_time(file.with_suffix(".lock")):
                    code = recall_code(file, made_for)  # another process has perhaps made it meanwhile
                    if code is None:
                        code = load_compiler().make_machine_code(self.py_func, arguments)
                        if source_unchanged() and self._content == file_hash(Path(self.py_func.__code__.co_filename)):
                            keep_code(file, made_for, code)
            self._loaded[kinds] = load_code(code, kinds, self.py_func.__qualname__)

    def _source(self) -> str:
        """What the folder's name does not say of the code: its file, perhaps of no compiled layer, its constants."""
        code, cells = self.py_func.__code__, self.py_func.__closure__ or ()
        constants = dict(zip(code.co_freevars, (cell.cell_contents for cell in cells), strict=True))
        if not all(isinstance(each, int | float | str) for each in constants.values()):
            raise TypeError(f"{self.py_func.__qualname__} is made from {constants}; a standalone kernel from numbers")
        return f"{self.py_func.__module__}.{self.py_func.__qualname__} of {self._content}, {constants}"


def scalar(function: F) -> F:
    """Compile a pure function of scalars; inlined into the lane loop that calls it, callable from Python too."""
    return _compiled(function, "scalar")


def lanes(function: F) -> F:
    """Compile a function that loops over lanes; inlined, so that the loop sees where its blocks live.

    Only kernels call it: it has no entry from Python.
    """
    return _compiled(function, "lanes")


def routine(function: F) -> F:
    """Compile a function that kernels call in many places: not inlined, and without an entry from Python."""
    return _compiled(function, "routine")


def kernel(function: F) -> F:
    """Compile an entry point called from Python: cached on disk by numba, releases the interpreter's lock."""
    _kernels.add(function)
    return _compiled(function, "kernel")


def standalone(function: F) -> F:
    """Compile an entry point called from Python that needs no numba once it is compiled (:class:`StandaloneKernel`).

    It takes floats, integers, truth values, contiguous arrays and named tuples of those. Releases the interpreter's
    lock. Its constants are numbers.
    """
    if _PLAIN:
        return function
    _kernels.add(function)
    return cast("F", StandaloneKernel(function))


def _compiled(function: F, role: str) -> F:
    if _PLAIN:
        function.py_func = function  # type: ignore[attr-defined]
        return function
    return cast("F", Compiled(function, role))


@functools.cache
def load_compiler() -> Any:
    """Numba, set up for this package, and taught what it needs to know."""
    with _lock:
        from abhv_mc import jit_compiler

        jit_compiler.on_compile(lambda function: announce_compiling() if function in _kernels else None)
        _teach_all()
    return jit_compiler


def before_compiling(teach: Callable[[], None]) -> Callable[[], None]:
    """Have ``teach`` tell numba about a function, as soon as numba is loaded. A decorator."""
    with _lock:
        _teachers.append(teach)
        if load_compiler.cache_info().currsize:
            _teach_all()
    return teach


def _teach_all() -> None:
    while _teachers:
        _teachers.pop()()


def on_first_compile(called: Callable[[], None]) -> None:
    """Have ``called`` called once, at the moment when a kernel is about to be compiled that the cache lacks."""
    _announcements.append(called)


def announce_compiling() -> None:
    """Tell whoever asked for it that a kernel is being compiled."""
    while _announcements:
        _announcements.pop()()
