"""Columns from and to arrays: the same as pyarrow's own way, and no pandas."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from abhv_mc.io.parquet_columns import column_values, distinct_texts, number_column, text_column

NUMBERS = [np.array([1.5, np.nan, -0.0]), np.arange(4), np.array([1.5, 2.5], np.float32), np.empty(0), np.eye(3)[:, 1]]


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


@pytest.mark.parametrize("values", NUMBERS, ids=["floats", "integers", "singles", "empty", "strided"])
def test_a_column_of_numbers(values):
    column = number_column(values)
    column.validate(full=True)
    assert column.type == pa.array(values).type
    assert np.array_equal(column.to_numpy(), values, equal_nan=True)


@pytest.mark.parametrize("texts", [["ok", "", "ground", "ok"], ["größer", "α"], []])
def test_a_column_of_texts(texts):
    column = text_column(texts)
    column.validate(full=True)
    assert column.equals(pa.array(texts, pa.string()))
    names, which = distinct_texts(pa.chunked_array([column]))
    assert names == sorted(set(texts))
    assert [names[i] for i in which] == texts


def test_none_of_them_imports_pandas():
    code = """
import sys, numpy as np, pyarrow as pa
from abhv_mc.io.parquet_columns import *
table = pa.table([number_column(np.arange(3.0)), text_column(["a", "b", "a"])], names=["x", "name"])
column_values(table["x"]), distinct_texts(table["name"])
print("pandas" in sys.modules)
"""
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
