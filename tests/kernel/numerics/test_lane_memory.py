"""Memory of lanes: where it begins."""

import numpy as np
import pytest

from abhv_mc.kernel.numerics.lane_memory import aligned_zeros


@pytest.mark.parametrize("dtype", [np.float64, np.int64, np.float32])
@pytest.mark.parametrize("shape", [7, (3, 5), (2, 3, 4)])
def test_memory_begins_with_a_cache_line_and_is_zero(shape, dtype) -> None:
    for _ in range(8):  # the system's own places differ
        memory = aligned_zeros(shape, dtype)
        assert memory.ctypes.data % 64 == 0
        assert memory.dtype == dtype and memory.flags.c_contiguous
        assert np.array_equal(memory, np.zeros(shape, dtype))
