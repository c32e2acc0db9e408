"""Numba's compiler, as much of it as this package's functions need: the same bits and speed after half of the time.

Functions here call each other a hundred deep, are all inlined into a few kernels, hold no closures, exceptions or
objects, and are typed over and over with the same few types. Seconds that each measure saves of a cold start that
takes 30 without them (measured alone; ``python -m abhv_mc bench`` has today's sum):

- inlined functions never become machine code by themselves: half of what numba would need;
- numba remembers what an operation on given types returns: 3;
- kernels are optimized once, and loops unrolled after that: a loop over lanes becomes two vectors (unrolled before,
  it would be scalar code): 2;
- functions are compiled once for all constants in their arguments: 2;
- no search for garbage while a kernel is compiled: 2;
- passes for what is not used here are left out: 1.
"""

import contextlib
import gc
from collections.abc import Callable, Iterator
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core import event, typed_passes, types, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import PassManager
from numba.core.registry import CPUDispatcher

from abhv_mc.code_cache import cache_folder
from abhv_mc.machine_code import MachineCode

# numba decides on the cache's place when it decorates, so this comes before any function is made.
numba.config.CACHE_DIR = str(cache_folder())  # type: ignore[attr-defined]
# LLVM's level 2: a tenth less to compile than level 3, and flights as fast.
numba.config.OPT = type(numba.config.OPT)(2)  # type: ignore[attr-defined]

_PASSES = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    untyped_passes.GenericRewrites,
    untyped_passes.ReconstructSSA,
    typed_passes.NopythonTypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.IRLegalization,
    typed_passes.NativeLowering,
    typed_passes.NoPythonBackend,
)


_Function: Any = types.BaseFunction
_ask = _Function.get_call_type
_known: dict[Any, Any] = {}


def _recall(function: Any, context: Any, arguments: Any, keywords: Any) -> Any:
    """What a call of one of numba's own functions returns; numba tries up to thirty templates at each ``a * b``."""
    if keywords or any(isinstance(each, types.Literal | types.Dispatcher) for each in arguments):
        return _ask(function, context, arguments, keywords)
    key = (function, context, *arguments)
    if key not in _known:
        _known[key] = _ask(function, context, arguments, keywords)
    return _known[key]


@contextlib.contextmanager
def _recalling() -> Iterator[None]:
    """Have numba remember types; its lock is held, nobody else compiles."""
    before = _Function.get_call_type
    _Function.get_call_type = _recall
    try:
        yield
    finally:
        _Function.get_call_type = before


@contextlib.contextmanager
def _without_collection() -> Iterator[None]:
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class _Compiler(Compiler):
    """Numba's compiler with fewer passes."""

    def define_pipelines(self) -> list[PassManager]:
        manager = PassManager("nopython")
        for each in _PASSES:
            manager.add_pass(each, each.name())
        manager.finalize()
        return [manager]


class _InlinedLibrary(JITCodeLibrary):
    """Code that only ever becomes part of another's: not optimized by itself, never made machine code."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "weak_odr"  # a linker drops a linkonce_odr that nobody calls yet
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        return self._final_module

    def with_called(self) -> list[Any]:
        """This and all that it calls at any depth, once each: a caller links them all."""
        return list(dict.fromkeys([self, *self._linking_libraries]))


class InlinedCompiler(_Compiler):
    """Compiles as far as LLVM's intermediate code."""

    def compile_extra(self, function: Any) -> Any:
        code = _InlinedLibrary(self.state.targetctx.codegen(), function.__qualname__)
        self.state.flags.no_compile = True
        self.state.flags.noalias = True  # a loop over lanes need not look for overlaps before it becomes vectors
        self.state["library"] = code
        result = super().compile_extra(function)
        entry = set[Any]().remove  # numba tells functions apart by a builtin, their entry, which nobody calls
        result.target_context.insert_user_function(entry, result.fndesc, code.with_called())
        return result._replace(entry_point=entry)


class _KernelLibrary(JITCodeLibrary):
    """Code that is optimized once, when everything that it calls is there, for loops over lanes."""

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if function.linkage == llvm.Linkage.weak_odr:
                function.linkage = "linkonce_odr"  # goes when it is inlined
        options = llvm.create_pipeline_tuning_options(speed_level=2)  # faster to compile than 3, flights as fast
        options.loop_vectorization = options.slp_vectorization = True
        options.loop_unrolling = options.loop_interleaving = False
        builder = llvm.create_pass_builder(self._codegen._tm, options)
        builder.getModulePassManager().run(self._final_module, builder)
        unroll = llvm.create_new_function_pass_manager()
        unroll.add_loop_unroll_pass()
        unroll.add_instruction_combine_pass()
        unroll.add_simplify_cfg_pass()
        for function in self._final_module.functions:
            if not function.is_declaration:
                unroll.run(function, builder)


class KernelCompiler(_Compiler):
    """Compiles what Python calls."""

    def compile_extra(self, function: Any) -> Any:
        code = _KernelLibrary(self.state.targetctx.codegen(), function.__qualname__)
        code.enable_object_caching()
        self.state["library"] = code
        with _recalling(), _without_collection():
            return super().compile_extra(function)


class _StandaloneLibrary(_KernelLibrary):
    """A kernel that becomes an object file, which LLVM here does not load."""

    def _finalize_final_module(self) -> None:
        self.object = self._codegen._tm.emit_object(self._final_module)
        self._finalized = True


class StandaloneCompiler(_Compiler):
    """Compiles a kernel that numba does not call."""

    def compile_extra(self, function: Any) -> Any:
        self.state.flags.no_compile = True
        code = _StandaloneLibrary(self.state.targetctx.codegen(), function.__qualname__)
        self.state["library"] = code
        with _recalling(), _without_collection():
            result = super().compile_extra(function)
            code.finalize()
        return result._replace(entry_point=set[Any]().remove)


class Inlined(CPUDispatcher):
    """A function that compiled code calls, compiled once for all constants in its arguments."""

    def __init__(self, function: Any, **options: Any) -> None:
        super().__init__(function, targetoptions={"nopython": True, **options}, pipeline_class=InlinedCompiler)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """What a call returns; to numba each constant is a type of its own."""
        return super().get_call_template(tuple(map(types.unliteral, args)), kws)


class Scalar(Inlined):
    """A function that is inlined where compiled code calls it, and compiled by itself where Python does."""

    def __init__(self, function: Any) -> None:
        super().__init__(function, **_INLINED, **_NO_ENTRY)
        self._called = numba.njit(**_INLINED, **_CALLED)(function)

    def __call__(self, *arguments: Any) -> Any:
        return self._called(*arguments)


# Without numba's reference counting (``_nrt``): nothing in here allocates, and an atomic count on each
# array of a named tuple in each lane costs three times the physics.
_INLINED: dict[str, Any] = {"forceinline": True, "error_model": "numpy", "_nrt": False}
_NO_ENTRY: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_CALLED: dict[str, Any] = {"cache": True, "no_cfunc_wrapper": True, "pipeline_class": KernelCompiler}

# What the decorators of :mod:`abhv_mc.jit` make of a function.
MAKERS: dict[str, Callable[[Any], Any]] = {
    "scalar": Scalar,
    "lanes": lambda function: Inlined(function, **_INLINED, **_NO_ENTRY),
    "routine": lambda function: Inlined(function, **{**_INLINED, "forceinline": False}, **_NO_ENTRY),
    "kernel": numba.njit(nogil=True, error_model="numpy", **_CALLED),
}


# What only numba has; a process without it could not load such code.
_NUMBAS = ("NRT_", "numba_", "Py", "_Py", "__svml")


def make_machine_code(function: Any, arguments: tuple[Any, ...]) -> MachineCode:
    """Compile a function for arguments of these types.

    Raises TypeError where it returns something or needs numba when it runs; numba's own where it allocates.
    """
    options: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
    dispatcher = numba.njit(**options, **_NO_ENTRY, pipeline_class=StandaloneCompiler)(function)
    signature = tuple(map(numba.typeof, arguments))
    dispatcher.compile(signature)
    made = dispatcher.overloads[signature]
    code: _StandaloneLibrary = made._asdict()["library"]
    called = [each.name for each in code._final_module.functions if each.is_declaration]
    needs = tuple(name for name in called if not name.startswith("llvm."))
    numbas = [name for name in needs if name.startswith(_NUMBAS)]
    if numbas or made.signature.return_type != types.none:
        raise TypeError(f"{function.__qualname__} returns {made.signature.return_type}, and needs {numbas}")
    return MachineCode(made.fndesc.llvm_func_name, needs, code.object)


class _Compiling(event.Listener):
    def __init__(self, called: Callable[[Any], None]) -> None:
        self._called = called

    def on_start(self, started: Any) -> None:
        self._called(started.data["dispatcher"].py_func)

    def on_end(self, ended: Any) -> None:
        pass


def on_compile(called: Callable[[Any], None]) -> None:
    """Have ``called`` called with each function that numba sets out to compile because its cache lacks it."""
    event.register("numba:compile", _Compiling(called))
