"""Calls of functions by address, so that custom control laws need no new kernel."""

from typing import Any

from abhv_mc_vehicle.kernel.jit import PLAIN, intrinsic, load_compiler


class Uncompilable(Exception):
    """Error for a custom function that numba cannot compile, with file, line and message."""

    def __init__(self, file: str | None, line: int | None, message: str) -> None:
        super().__init__(file, line, message)
        self.file = file
        self.line = line
        self.message = message


def _call_address(
    typing_context: Any,
    address: Any,
    context_address: Any,
    Z: Any,
    reference: Any,
    gains: Any,
    settings: Any,
    tick: Any,
    dt: Any,
) -> Any:
    """Call a function compiled by :func:`compile_pointer` at its address.

    ``context_address`` is the address of data used by the function, 0 for none.
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
    """Call a C function at an address with int64 (or pointer), int32 or float64 arguments.

    ``arguments`` is a tuple. The C function returns an ``int``.
    """
    from llvmlite import ir
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, operands: Any) -> Any:
        values = [builder.extract_value(operands[1], i) for i in range(len(arguments))]
        kind = ir.FunctionType(ir.IntType(32), [value.type for value in values])
        return builder.call(builder.inttoptr(operands[0], kind.as_pointer()), values)

    return types.int32(types.int64, arguments), generate


@intrinsic
def address_of(typing_context: Any, pointer: Any) -> Any:
    """Return the address stored in a pointer."""
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, operands: Any) -> Any:
        return builder.ptrtoint(operands[0], context.get_value_type(types.int64))

    return types.int64(pointer), generate


@intrinsic
def floats_at(typing_context: Any, address: Any) -> Any:
    """Return a pointer to floats at an address."""
    from numba import types

    kind = types.CPointer(types.float64)

    def generate(context: Any, builder: Any, signature: Any, operands: Any) -> Any:
        return builder.inttoptr(operands[0], context.get_value_type(kind))

    return kind(types.int64), generate


def compile_pointer(function: Any) -> Any:
    """Compile a loop over lanes that kernels call by address, see :func:`call_address`.

    The function's file must exist, because numba caches the machine code under its name. Raise
    Uncompilable if numba cannot compile it.
    """
    if PLAIN:
        raise Uncompilable(None, None, "NUMBA_DISABLE_JIT is set, so nothing is compiled")
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
        location = getattr(error, "loc", None)
        raise Uncompilable(
            getattr(location, "filename", None), getattr(location, "line", None), str(error)
        ) from None
