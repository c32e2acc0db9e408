"""Decorators for compiled functions; no other module uses numba's decorators.

Compiled functions follow these rules, which are based on measurements (``make bench``):

- Use strict floating point, so that a flight in a group is bit-identical to a single flight.
- A ``scalar`` function takes and returns only floats and named tuples of floats.
- A ``lanes`` function loops over the lanes of arrays that its caller has allocated.
- The array arguments of a function that writes to one of them must not overlap.
- Do not call libm inside a lane loop; use :mod:`abhv_mc_vehicle.kernel.numerics.lane_math`.
- Pass data (tables, gains, references) as arguments, because numba treats globals as constants.

Numba compiles the functions and stores the kernels in its disk cache. Subclasses of numba's private
classes inline all functions into a few kernels (``docs/explanation/performance.md``). Numba's
public interface gives bit-identical results, but slower code.
"""

import contextlib
import functools
import gc
import hashlib
import io
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, TypeVar

import numpy as np

from abhv_mc_vehicle.kernel.cache import compilation_lock, is_noted, source_unchanged, unpack
from abhv_mc_vehicle.kernel.compiler_target import (
    PUBLIC,
    choose_interface,
    choose_target,
    code_folder,
)

F = TypeVar("F", bound=Callable[..., Any])
# Maximum number of arrays in the arguments of a function that is compiled with noalias. A vehicle
# contains fewer arrays, a plan more.
_MOST_ARRAYS = 40

# True if numba is disabled and all functions are plain Python, for example to count operations.
PLAIN = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


def scalar(function: F) -> F:
    """Compile a pure scalar function, which is inlined into lane loops or called by Python."""
    return _decorate("inlined", function, error_model="numpy", forceinline=True)


# Functions that loop over lanes are inlined, so that the compiler knows the layout of their arrays.
lanes = scalar


def routine(function: F) -> F:
    """Compile a function that kernels call often, without inlining it."""
    return _decorate("inlined", function, error_model="numpy")


def kernel(function: F) -> F:
    """Compile an entry point for Python that is cached on disk and runs without the GIL.

    A kernel that is defined inside another function may use that function's numbers but not its
    local functions, because numba would not find the cached code again.
    """
    return _decorate("kernel", function, error_model="numpy", nogil=True)


def intrinsic(function: F) -> F:
    """Make a numba intrinsic from a function that returns a signature and a code generator."""
    return _decorate("intrinsic", function)


def _decorate(kind: str, function: Any, **options: Any) -> Any:
    if PLAIN:
        function.py_func = function
        return function
    return _Deferred(kind, function, options)


class _Deferred:
    """Function that numba decorates when it is first called by Python or by compiled code.

    Reports and custom simulators compile nothing, so they avoid importing numba, which takes 0.3 s.
    """

    def __init__(self, kind: str, function: Any, options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.py_func = function
        self._kind = kind
        self._options = options
        self._made: Any = None

    @property
    def decorated(self) -> Any:
        """Function decorated by numba."""
        if self._made is None:
            with _lock:
                if self._made is None:
                    self._made = load_compiler().makers[self._kind](self.py_func, **self._options)
        return self._made

    def __call__(self, *arguments: Any) -> Any:
        return self.decorated(*arguments)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # Copying and unpickling read attributes before they are set.
            raise AttributeError(name)
        return getattr(self.decorated, name)


_at_load: list[Callable[[], None]] = []


def when_loaded(register: Callable[[], None]) -> Callable[[], None]:
    """Register a function that needs numba, to be called when numba is imported."""
    _at_load.append(register)
    if load_compiler.cache_info().currsize:
        register()
    return register


def compiler() -> str:
    """Return which numba interface is used for compilation: ``private`` or ``public``."""
    return load_compiler().interface


def is_cached(function: Any) -> bool:
    """Return whether the disk cache contains compiled code of a kernel."""
    folder = None if PLAIN else function.stats.cache_path
    return folder is not None and is_noted(Path(folder), function.py_func.__name__)


class _Kernels:
    """Listener for numba's events that holds the contexts of kernels being compiled."""

    def __init__(self) -> None:
        self._open = contextlib.ExitStack()

    def notify(self, event: Any) -> None:
        if event.data["dispatcher"].targetoptions.get("nogil"):  # Only kernels have this option.
            if event.is_start:
                self._open.enter_context(_tell(event.data["dispatcher"].py_func, False))
            else:
                self.end()

    def end(self) -> None:
        """Close the contexts of all kernels, including those with interrupted compilation."""
        self._open.close()


_kernels = _Kernels()
_lock = threading.RLock()


def _say_nothing(function: Any, elsewhere: bool) -> AbstractContextManager[None]:
    return contextlib.nullcontext()


_tell: Callable[[Any, bool], AbstractContextManager[None]] = _say_nothing


def set_compile_listener(listener: Callable[[Any, bool], AbstractContextManager[None]]) -> None:
    """Set the context that is entered while this or another process compiles a kernel.

    ``listener`` receives the kernel's function, and whether another process compiles it.
    """
    global _tell  # noqa: PLW0603  one listener for all kernels
    _tell = listener


@contextlib.contextmanager
def _deferred_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of the context if an interrupt occurred inside it.

    An interrupt inside numba or LLVM could be lost in a callback or cause a different error.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []

    def note(number: int, frame: Any) -> None:
        received.append(number)
        raise KeyboardInterrupt

    handlers = {
        n: signal.getsignal(n)
        for n in (signal.SIGINT, signal.SIGTERM)
        if callable(signal.getsignal(n))
    }
    for number in handlers:
        signal.signal(number, note)
    try:
        yield
    except Exception:
        if received:
            raise KeyboardInterrupt from None
        raise
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if received:
        raise KeyboardInterrupt


def _make_private() -> tuple[Any, Any]:
    """Return subclasses of numba's private classes for inlined functions and for kernels."""
    from llvmlite.binding import parse_assembly
    from numba.core import config, types
    from numba.core.caching import (
        CompileResultCacheImpl,
        FunctionCache,
        NullCache,
        UserProvidedCacheLocator,
    )
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import Compiler
    from numba.core.registry import CPUDispatcher
    from numba.core.runtime.nrt import rtsys
    from numba.core.serialize import NumbaPickler

    def count_arrays(kinds: Any) -> int:
        tuples = [kind for kind in kinds if isinstance(kind, types.BaseTuple)]
        return sum(isinstance(kind, types.Array) for kind in kinds) + sum(map(count_arrays, tuples))

    class InlinedLibrary(JITCodeLibrary):
        """Code that is linked into kernels, and not translated to machine code separately."""

        def finalize(self) -> None:
            self._finalized = True

        def part(self) -> Any:
            return super()._get_module_for_linking()

        def _get_module_for_linking(
            self,
        ) -> Any:  # Numba links its own functions together with all functions that they call.
            return link(self.part().clone(), self)

    def link(module: Any, caller: Any) -> Any:
        """Link the module with all functions that ``caller`` calls directly or indirectly.

        A function is linked after all its callers, because LLVM omits functions without a caller.
        """
        order: dict[Any, None] = {}

        def visit(library: Any) -> None:
            for called in (
                library._linking_libraries
                if library is caller or isinstance(library, InlinedLibrary)
                else ()
            ):
                if called not in order:
                    visit(called)
            order[library] = None

        visit(caller)
        for library in list(order)[-2::-1]:
            piece = (
                library.part()
                if isinstance(library, InlinedLibrary)
                else library._get_module_for_linking()
            )
            module.link_in(piece, preserve=True)
        return module

    class InlinedCompiler(Compiler):
        def compile_extra(self, function: Any) -> Any:
            library = InlinedLibrary(self.state.targetctx.codegen(), function.__qualname__)
            self.state["library"] = library
            self.state.flags.no_compile = True
            # Without noalias, LLVM checks for overlap before a vectorized loop over lanes.
            # With noalias for all arrays of a plan, LLVM would spend most time on lists of arrays.
            self.state.flags.noalias = count_arrays(self.state.args) <= _MOST_ARRAYS
            result = super().compile_extra(function)
            entry = set[
                Any
            ]().remove  # Numba identifies a function by a builtin, which is never called.
            result.target_context.insert_user_function(entry, result.fndesc, [library])
            return result._replace(entry_point=entry)

    class Inlined(CPUDispatcher):
        def __init__(self, function: Any, **options: Any) -> None:
            # Reference counting of arrays (_nrt) would take longer than the simulation itself.
            options |= {
                "nopython": True,
                "_nrt": False,
                "no_cpython_wrapper": True,
                "no_cfunc_wrapper": True,
            }
            super().__init__(function, targetoptions=options, pipeline_class=InlinedCompiler)

        def get_call_template(self, args: Any, kws: Any) -> Any:
            # Calls with literal arguments share one compiled function, although numba gives each
            # literal its own type.
            return super().get_call_template(tuple(map(types.unliteral, args)), kws)

        def __repr__(self) -> str:  # The name of the type is part of symbols of compiled code.
            return f"{self.py_func.__module__}.{self.py_func.__qualname__}"

        @functools.cached_property
        def kernel(self) -> Any:
            return Kernel(self.py_func, **{**self.targetoptions, "no_cpython_wrapper": False})

        def __call__(self, *arguments: Any) -> Any:
            return self.kernel(*arguments)

    class KernelLibrary(JITCodeLibrary):
        """Machine code stored with symbol names but without LLVM IR; it is not linked further."""

        def finalize(self) -> None:
            link(self._final_module, self)
            self._linking_libraries = []
            super().finalize()

        def serialize_using_object_code(self) -> Any:
            names = [f.name for f in self._final_module.functions if not f.is_declaration]
            stubs = parse_assembly("\n".join(f'@"{name}" = global i8 0' for name in names))
            return self.name, "object", (self._get_compiled_object(), stubs.as_bitcode())

    class ContentLocator(UserProvidedCacheLocator):
        """Cache location that depends on a module's name and content, not its path and time.

        Another clone, environment or container with the same source loads the same code.
        """

        def __init__(self, function: Any, file: str) -> None:
            super().__init__(function, file)
            self._cache_path = str(Path(config.CACHE_DIR) / function.__module__)  # type: ignore[attr-defined]

        def get_source_stamp(self) -> str:
            return hashlib.sha256(Path(self._py_file).read_bytes()).hexdigest()

    class KernelCacheImpl(CompileResultCacheImpl):
        _locator_classes = [ContentLocator, *CompileResultCacheImpl._locator_classes]

        def reduce(self, data: Any) -> Any:
            # The annotation of types contains the paths of files.
            return data._replace(type_annotation="")._reduce()

    class KernelPickler(NumbaPickler):
        """Pickler without the numbers of types, which depend on the order of compilation."""

        def reducer_override(self, obj: Any) -> Any:
            if not isinstance(obj, types.Type):
                return super().reducer_override(obj)
            reduced: Any = obj.__reduce__()
            build, (function, arguments, state) = reduced
            return build, (function, arguments, {**state, "_code": 0})

    def dump(obj: Any) -> bytes:
        content = io.BytesIO()
        KernelPickler(content, protocol=4).dump(obj)
        return content.getvalue()

    class KernelCache(FunctionCache):
        """Cache that loads kernels without numpy's typing rules, which only compiling needs."""

        _impl_class = KernelCacheImpl

        def save_overload(self, sig: Any, data: Any) -> None:
            # A name of the kernel's content instead of a number: without a folder lock, two
            # processes could give two kernels the same number, and builds would differ.
            file: Any = self._cache_file
            key = repr(self._index_key(sig, data.codegen)).encode()
            digest = hashlib.sha256(key).hexdigest()[:16]
            file._data_name_pattern = f"{self._impl.filename_base}.{digest}.nbc"
            file._dump = dump
            super().save_overload(sig, data)

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            rtsys.initialize(target_context)
            return self._load_overload(sig, target_context)

    class KernelCompiler(Compiler):
        def compile_extra(self, function: Any) -> Any:
            self.state["library"] = library = KernelLibrary(
                self.state.targetctx.codegen(), function.__qualname__
            )
            library.enable_object_caching()
            return super().compile_extra(function)

    class Kernel(CPUDispatcher):
        def __init__(self, function: Any, **options: Any) -> None:
            options |= {"nopython": True, "no_cfunc_wrapper": True}
            super().__init__(function, targetoptions=options, pipeline_class=KernelCompiler)
            self._cache: Any = KernelCache(function)

        def compile(self, sig: Any) -> Any:
            if (
                not source_unchanged()
            ):  # Do not store code under the hash of a source that was edited in the meantime.
                self._cache = NullCache()
            with contextlib.ExitStack() as stack:
                stack.enter_context(_deferred_interrupts())
                stack.callback(_kernels.end)
                waiting = functools.partial(_tell, self.py_func, True)
                stack.enter_context(
                    compilation_lock(self.stats.cache_path, self.py_func.__name__, waiting)
                )
                if gc.isenabled():
                    gc.disable()
                    stack.callback(gc.enable)
                try:
                    return super().compile(sig)
                except (
                    OSError,
                    EOFError,
                    UnpicklingError,
                ):  # The disk may be full, or a cache file may be damaged.
                    with contextlib.suppress(OSError):
                        self._cache.flush()
                    return super().compile(sig)

    return Inlined, Kernel


@dataclass(frozen=True)
class _Compiler:
    interface: str  # interface of numba: private or public
    makers: dict[str, Callable[..., Any]]  # decorators that accept numba's options, by kind


@functools.cache
def load_compiler() -> _Compiler:
    """Import numba and set its target and cache folder, at the first call only."""
    import numba
    from numba.core import event, registry
    from numba.core.typing.typeof import typeof_impl
    from numba.extending import intrinsic

    config: Any = numba.config
    interface = choose_interface()
    level = choose_target(interface)
    # numba reads the cache folder when it decorates a function.
    config.CACHE_DIR = str(code_folder(interface))
    if level is not None:
        unpack(level, code_folder(interface))
    inlined: Callable[..., Any] = numba.njit
    kernel: Callable[..., Any] = functools.partial(numba.njit, cache=True)
    if interface == "private":
        try:
            private = _make_private()
            _try_once(code_folder(interface), *private)
            inlined, kernel = private
        except Exception as error:
            warnings.warn(
                f"The private interface of numba {numba.__version__} is not supported "
                f"({type(error).__name__}: {error}). Flights run more slowly with its public "
                "interface; the results are the same.",
                RuntimeWarning,
                stacklevel=2,
            )
            # The variable makes child processes use the public interface directly.
            os.environ[PUBLIC] = "1"
            interface = "public"
            config.CACHE_DIR = str(code_folder(interface))

    @typeof_impl.register(_Deferred)
    def _(deferred: Any, context: Any) -> Any:
        decorated = deferred.decorated
        typing_context = registry.cpu_target.typing_context
        typing_context.refresh()  # This registers intrinsics with numba.
        return typing_context.resolve_value_type(decorated)

    event.Listener.register(_Kernels)
    event.register("numba:compile", _kernels)
    for register in _at_load:
        register()
    return _Compiler(interface, {"inlined": inlined, "kernel": kernel, "intrinsic": intrinsic})


def _try_once(folder: Path, inlined: Any, kernel: Any) -> None:
    """Compile two functions as a test, once per folder and numba version; this takes 0.5 s."""
    global _twice  # noqa: PLW0603  a module global, like the functions that kernels call
    tried = folder / "tried"
    if not tried.exists():
        _twice = inlined(lambda x: x + x, error_model="numpy", forceinline=True)
        kernel(_try, error_model="numpy", nogil=True)(np.ones(2))
        with contextlib.suppress(OSError):
            tried.touch()


_twice: Any = None


def _try(row: Any) -> None:
    row[0] = _twice(row[0])
