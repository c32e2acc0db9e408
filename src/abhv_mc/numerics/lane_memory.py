"""Memory of lanes: rows that begin with a cache line, and a width that is a constant of the machine code.

A vector of eight doubles is a cache line long: where rows begin elsewhere each load and store touches two.
"""

from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, type_callable
from numba.np.arrayobj import make_array
from numpy.typing import NDArray

_LINE = 64  # bytes


def aligned_zeros(shape: tuple[int, ...] | int, dtype: type[np.generic] = np.float64) -> NDArray[Any]:
    """An array of zeros that begins with a cache line."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + _LINE, dtype=np.uint8)
    start = -memory.ctypes.data % _LINE
    return memory[start : start + size].view(dtype).reshape(shape)


def known_width(rows: NDArray[Any], width: int) -> NDArray[Any]:
    """``rows`` [row, lane], which has ``width`` lanes; where that is a constant, compiled code knows where rows lie."""
    return rows


@type_callable(known_width)
def _type_known_width(context: Any) -> Any:
    return lambda rows, width: rows


@lower_builtin(known_width, types.Array, types.Integer)
def _set_width(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    rows = signature.args[0]
    array = make_array(rows)(context, builder, arguments[0])
    width = context.cast(builder, arguments[1], signature.args[1], types.intp)
    count = builder.extract_value(array.shape, 0)
    item = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(rows.dtype)))
    array.shape = cgutils.pack_array(builder, [count, width])
    array.strides = cgutils.pack_array(builder, [builder.mul(width, item), item])
    return array._getvalue()
