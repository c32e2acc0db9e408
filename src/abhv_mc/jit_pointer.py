"""Functions that compiled code calls by their address, so that a user's law needs no new kernel."""

from typing import Any

import numba
from numba import types
from numba.core.errors import NumbaError
from numba.extending import intrinsic, overload

from abhv_mc.jit import PLAIN


class Uncompilable(Exception):
    """A user's function that numba does not compile: where, as far as known, and what numba says."""

    def __init__(self, file: str | None, line: int | None, words: str) -> None:
        super().__init__(file, line, words)
        self.file, self.line, self.words = file, line, words


def call_address(address: int, Z: Any, reference: Any, gains: Any, settings: Any, tick: int, dt: float) -> None:
    """Call a function that :func:`compile_pointer` compiled, from compiled code, by its address."""
    raise TypeError("only compiled code calls an address")


@intrinsic
def _call_address(
    context: Any, address: Any, Z: Any, reference: Any, gains: Any, settings: Any, tick: Any, dt: Any
) -> Any:
    arrays = (Z, reference, gains, settings)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if "cuda" not in type(context).__module__:  # a GPU refuses such a law before it flies
            from llvmlite import ir

            pointers = [
                context.make_array(kind)(context, builder, value).data
                for kind, value in zip(arrays, arguments[1:5], strict=True)
            ]
            values = [*pointers, *arguments[5:]]
            kind = ir.FunctionType(ir.VoidType(), [value.type for value in values])
            builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), values)
        return context.get_dummy_value()

    return types.void(types.int64, *arrays, types.int64, types.float64), generate


@overload(call_address, jit_options={"forceinline": True}, strict=False)
def _overload_call_address(address: Any, Z: Any, reference: Any, gains: Any, settings: Any, tick: Any, dt: Any) -> Any:
    return lambda address, Z, reference, gains, settings, tick, dt: _call_address(  # noqa: PLW0108
        address, Z, reference, gains, settings, tick, dt
    )  # type: ignore[call-arg]


_SIGNATURE = types.void(*4 * [types.CPointer(types.float64)], types.int64, types.float64)


def compile_pointer(function: Any) -> Any:
    """Compile a loop over lanes that flights call through its ``address``; it takes what :func:`call_address` does.

    Its file must exist: numba keeps the machine code under its name. Raises :class:`Uncompilable`.
    """
    if PLAIN:
        raise Uncompilable(None, None, "nothing is compiled where NUMBA_DISABLE_JIT is set")
    try:
        return numba.cfunc(_SIGNATURE, cache=True, error_model="numpy")(function)
    except NumbaError as error:
        place = getattr(error, "loc", None)
        raise Uncompilable(getattr(place, "filename", None), getattr(place, "line", None), str(error)) from None
