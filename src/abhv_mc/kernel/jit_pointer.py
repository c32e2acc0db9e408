"""Functions that compiled code calls by their address, so that a user's law needs no new kernel."""

from typing import Any

from abhv_mc.kernel.jit import PLAIN, intrinsic, load_compiler


class Uncompilable(Exception):
    """A user's function that numba does not compile: where, as far as known, and what numba says."""

    def __init__(self, file: str | None, line: int | None, words: str) -> None:
        super().__init__(file, line, words)
        self.file, self.line, self.words = file, line, words


def _call_address(
    typing_context: Any,
    address: Any,
    own: Any,
    Z: Any,
    reference: Any,
    gains: Any,
    settings: Any,
    tick: Any,
    dt: Any,
) -> Any:
    """Call a function that :func:`compile_pointer` compiled, from compiled code, by its address.

    ``own``: address of whatever numbers it was made with, 0 for none.
    """
    from numba import types

    arrays = (Z, reference, gains, settings)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        from llvmlite import ir

        word = ir.IntType(64)
        pointers = [
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(arrays, arguments[2:6], strict=True)
        ]
        values = [builder.inttoptr(arguments[1], word.as_pointer()), *pointers, *arguments[6:]]
        kind = ir.FunctionType(ir.VoidType(), [value.type for value in values])
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), values)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, *arrays, types.int64, types.float64), generate


call_address: Any = intrinsic(_call_address)


@intrinsic
def call_c(typing_context: Any, address: Any, arguments: Any) -> Any:
    """``int`` of a C function at an address, called with a tuple: int64 for pointers and sizes, int32, float64."""
    from llvmlite import ir
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        values = [builder.extract_value(given[1], i) for i in range(len(arguments))]
        kind = ir.FunctionType(ir.IntType(32), [value.type for value in values])
        return builder.call(builder.inttoptr(given[0], kind.as_pointer()), values)

    return types.int32(types.int64, arguments), generate


@intrinsic
def address_of(typing_context: Any, pointer: Any) -> Any:
    """The address that a pointer holds."""
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.ptrtoint(given[0], context.get_value_type(types.int64))

    return types.int64(pointer), generate


@intrinsic
def floats_at(typing_context: Any, address: Any) -> Any:
    """The pointer to floats at an address."""
    from numba import types

    kind = types.CPointer(types.float64)

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.inttoptr(given[0], context.get_value_type(kind))

    return kind(types.int64), generate


def compile_pointer(function: Any) -> Any:
    """Compile a loop over lanes that flights call through its ``address``; it takes what :func:`call_address` does.

    Its file must exist: numba keeps the machine code under its name. Raises :class:`Uncompilable`.
    """
    if PLAIN:
        raise Uncompilable(None, None, "nothing is compiled where NUMBA_DISABLE_JIT is set")
    load_compiler()
    import numba
    from numba import types
    from numba.core.errors import NumbaError

    row = types.CPointer(types.float64)
    signature = types.void(
        types.CPointer(types.int64), row, row, row, row, types.int64, types.float64
    )
    try:
        return numba.cfunc(signature, cache=True, error_model="numpy")(function)
    except NumbaError as error:
        place = getattr(error, "loc", None)
        raise Uncompilable(
            getattr(place, "filename", None), getattr(place, "line", None), str(error)
        ) from None
