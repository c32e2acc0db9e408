"""Conversion of a float's 64 bits to an integer and back.

Plain Python uses ``struct``; compiled code uses one LLVM bitcast, which vectorizes.
"""

import struct
from typing import Any

from abhv_mc_vehicle.kernel.jit import when_loaded


def float_bits(x: float) -> int:
    """Return the bits of a float as a signed 64-bit integer."""
    return int(struct.unpack("<q", struct.pack("<d", x))[0])


def bits_float(bits: int) -> float:
    """Return the float whose bits are a signed 64-bit integer."""
    return float(struct.unpack("<d", struct.pack("<q", bits))[0])


@when_loaded
def _overload_both() -> None:
    from numba import types
    from numba.extending import intrinsic, overload

    @intrinsic
    def _to_int64(typing_context: Any, x: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], context.get_value_type(types.int64))

        return types.int64(types.float64), generate

    @intrinsic
    def _to_float64(typing_context: Any, bits: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], context.get_value_type(types.float64))

        return types.float64(types.int64), generate

    @overload(float_bits, jit_options={"forceinline": True}, strict=False)
    def _float_bits(x: Any) -> Any:
        return lambda x: _to_int64(x)  # type: ignore[call-arg]  # noqa: PLW0108

    @overload(bits_float, jit_options={"forceinline": True}, strict=False)
    def _bits_float(bits: Any) -> Any:
        return lambda bits: _to_float64(bits)  # type: ignore[call-arg]  # noqa: PLW0108
