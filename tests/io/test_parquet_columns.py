"""Columns as arrays: the same numbers as pyarrow's own way, and no pandas."""

import numpy as np
import pyarrow as pa
import pytest

from abhv_mc.io.parquet_columns import column_values


@pytest.mark.parametrize(
    "column",
    [
        pa.chunked_array([[1.5, float("nan")], [float("inf"), -0.0]]),
        pa.chunked_array([pa.array([3, 4, 5], pa.int64())]),
        pa.chunked_array([pa.array([1.5, None], pa.float64()), [2.0]]),
        pa.chunked_array([], pa.float64()),
        pa.chunked_array([pa.array([0.0, 1.0, 2.0, 3.0]).slice(1, 2)]),
    ],
    ids=["chunks", "integers", "nulls", "empty", "part"],
)
def test_the_numbers(column):
    found = column_values(column)
    assert found.dtype == column.to_numpy().dtype
    assert np.array_equal(found, column.to_numpy(), equal_nan=found.dtype == np.float64)
