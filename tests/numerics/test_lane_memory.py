"""Memory of lanes: where it begins, and that compiled code finds its rows."""

import numpy as np
import pytest

from abhv_mc.jit import bare_kernel
from abhv_mc.numerics.lane_memory import aligned_zeros, known_width

WIDTH = 5


@bare_kernel
def number_all(rows):
    known = known_width(rows, WIDTH)
    for row in range(known.shape[0]):
        for lane in range(known.shape[1]):
            known[row, lane] = 10 * row + lane


@pytest.mark.parametrize("dtype", [np.float64, np.int64, np.float32])
@pytest.mark.parametrize("shape", [7, (3, 5), (2, 3, 4)])
def test_memory_begins_with_a_cache_line_and_is_zero(shape, dtype) -> None:
    for _ in range(8):  # the system's own places differ
        memory = aligned_zeros(shape, dtype)
        assert memory.ctypes.data % 64 == 0
        assert memory.dtype == dtype and memory.flags.c_contiguous
        assert np.array_equal(memory, np.zeros(shape, dtype))


def test_rows_lie_where_the_known_width_says() -> None:
    rows = aligned_zeros((4, WIDTH))
    number_all(rows)
    assert np.array_equal(rows, 10 * np.arange(4)[:, None] + np.arange(WIDTH))


def test_plain_python_takes_rows_as_they_are() -> None:
    rows = aligned_zeros((4, WIDTH))
    assert known_width(rows, WIDTH) is rows
