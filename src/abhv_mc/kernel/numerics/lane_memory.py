"""Memory of lanes begins with a cache line: vectors of eight doubles are as long, and would otherwise touch two."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

_LINE = 64  # bytes


def aligned_zeros(shape: tuple[int, ...] | int, dtype: type[np.generic] = np.float64) -> NDArray[Any]:
    """An array of zeros that begins with a cache line."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + _LINE, dtype=np.uint8)
    start = -memory.ctypes.data % _LINE
    return memory[start : start + size].view(dtype).reshape(shape)
