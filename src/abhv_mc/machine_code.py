"""Machine code of kernels: kept on disk, loaded and called without the compiler that made it.

Loading numba takes longer than a flight's whole start. What it compiled needs none of it: an object file, the name of
a function in there, and numba's way of passing arguments, which is simple. A named tuple is its members one after
another; an array is seven and more: two owners (none here), its size, the size of an item, its place, and for each
axis the length and the stride in bytes. Before them come the places of the result and of an exception; what comes
back is zero if all went well.

Code is only ever called with the types of arguments that it was made for, on the processor that it was made for.
"""

import contextlib
import ctypes
import hashlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.io.atomic_write import atomic_write

Kinds = tuple[Any, ...]

_SCALARS: dict[type, Any] = {float: ctypes.c_double, int: ctypes.c_int64, bool: ctypes.c_uint8}
_KINDS: dict[type, type] = {float: float, np.float64: float, int: int, np.int64: int, bool: bool}
_DTYPES = frozenset(map(np.dtype, ("f8", "f4", "i8", "i4", "u8", "u4")))
_INTEGERS = range(-(2**63), 2**63)

# Numba's settings that change the code.
_SETTINGS = ("CPU_NAME", "CPU_FEATURES", "ENABLE_AVX", "BOUNDSCHECK", "DISABLE_INTEL_SVML", "DEBUGINFO")


@dataclass(frozen=True)
class MachineCode:
    """An object file with one function for Python."""

    symbol: str  # the function's name
    needs: tuple[str, ...]  # functions of other libraries that it calls
    data: bytes


def flatten(arguments: tuple[Any, ...]) -> tuple[Kinds, list[Any]]:
    """What kind each argument is, and all of them one after another as compiled code takes them.

    Raises TypeError for what is neither float, int, bool, array of numbers nor a tuple of those.
    """
    kinds: list[Any] = []
    flat: list[Any] = []
    for argument in arguments:
        _flatten(argument, kinds, flat)
    return tuple(kinds), flat


def _flatten(value: Any, kinds: list[Any], flat: list[Any]) -> None:
    of = type(value)
    if of is np.ndarray and value.dtype in _DTYPES and value.flags.c_contiguous and value.flags.aligned:
        place, writeable = value.__array_interface__["data"]
        kinds.append((value.dtype, value.ndim, not writeable))
        flat += (None, None, value.size, value.itemsize, place, *value.shape, *value.strides)
    elif isinstance(value, tuple):
        kinds.append((of, len(value)))
        for member in value:
            _flatten(member, kinds, flat)
    elif of in _KINDS and (of is not int or value in _INTEGERS):
        kinds.append(_KINDS[of])
        flat.append(value)
    else:
        raise TypeError(f"a kernel takes no {of.__name__} such as {value!r:.60}; arrays are contiguous")


def _passed_as(kinds: Kinds) -> Iterator[Any]:
    """The C types of what :func:`flatten` makes of arguments of these kinds."""
    for kind in kinds:
        if isinstance(kind, type):
            yield _SCALARS[kind]
        elif isinstance(kind[0], np.dtype):
            yield from (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_ssize_t, ctypes.c_void_p)
            yield from [ctypes.c_ssize_t] * (2 * kind[1])


def describe(kinds: Kinds) -> str:
    """The kinds in words that mean the same in every process: what code was made for."""
    words = []
    for kind in kinds:
        if isinstance(kind, type):
            words.append(kind.__name__)
        elif isinstance(kind[0], np.dtype):
            words.append(f"{kind[0].str}[{kind[1]}]{' constant' if kind[2] else ''}")
        else:
            fields = " ".join(getattr(kind[0], "_fields", ()))
            words.append(f"{kind[0].__module__}.{kind[0].__qualname__}({kind[1]}: {fields})")
    return ", ".join(words)


@cache
def describe_processor() -> str:
    """The processor as numba sees it: its settings (environment) may hide some of it."""
    llvm = _llvm()
    settings = [f"{name}={os.environ.get(f'NUMBA_{name}')}" for name in _SETTINGS]
    parts = llvm.get_default_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten(), *settings
    return "\n".join(parts)


def keep_code(file: Path, made_for: str, code: MachineCode) -> None:
    """Keep code in a file; a disk that takes no more is no fault."""
    head = "\n".join((made_for.replace("\n", " "), code.symbol, " ".join(code.needs), "")).encode()
    content = head + code.data
    with contextlib.suppress(OSError), atomic_write(file) as aside:
        aside.write_bytes(hashlib.sha256(content).hexdigest().encode() + b"\n" + content)


def recall_code(file: Path, made_for: str) -> MachineCode | None:
    """The code kept in a file; None where there is none, or not whole, or made for something else."""
    try:
        digest, _, content = file.read_bytes().partition(b"\n")
        if hashlib.sha256(content).hexdigest().encode() != digest:
            return None
        kept_for, symbol, needs, data = content.split(b"\n", 3)
    except (OSError, ValueError):
        return None
    code = MachineCode(symbol.decode(), tuple(needs.decode().split()), data)
    whole = kept_for.decode() == made_for.replace("\n", " ") and all(map(_llvm().address_of_symbol, code.needs))
    return code if whole else None


def load_code(code: MachineCode, kinds: Kinds, name: str) -> Callable[[list[Any]], None]:
    """Have code called with what :func:`flatten` makes of arguments of these kinds.

    The interpreter's lock is released meanwhile. Raises RuntimeError where the function says that it failed.
    """
    llvm = _llvm()
    engine = _make_engine(llvm)  # its own: functions in other code may have the same names
    engine.add_object_file(llvm.ObjectFileRef.from_data(code.data))
    engine.finalize_object()
    prototype = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, *_passed_as(kinds))
    function = prototype(engine.get_function_address(code.symbol))

    def call(flat: list[Any]) -> None:
        result, exception = ctypes.c_void_p(), ctypes.c_void_p()  # nobody reads them, but they are written
        status = function(ctypes.addressof(result), ctypes.addressof(exception), *flat)
        if status:
            raise RuntimeError(f"{name} ended with status {status}")

    call.engine = engine  # type: ignore[attr-defined]  # the code lives as long as this
    return call


@cache
def _llvm() -> Any:
    """LLVM as numba brings it along, ready for this machine."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    _make_engine(llvm)  # the first has LLVM find what is in this process
    return llvm


def _make_engine(llvm: Any) -> Any:
    module = llvm.parse_assembly(f'target triple = "{llvm.get_default_triple()}"')
    return llvm.create_mcjit_compiler(module, llvm.Target.from_default_triple().create_target_machine())
