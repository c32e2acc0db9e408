"""CSV as it stands, with the place of every mistake; columns as pyarrow has them, without pandas; atomic writes."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.input_error import InputError
from abhv_mc.io.number_table import read_number_table
from abhv_mc.io.parquet_columns import column_values, distinct_texts, number_column, text_column


def read(folder, text, columns=None):
    (folder / "table.csv").write_bytes(text.encode() if isinstance(text, str) else text)
    return read_number_table(folder / "table.csv", columns)


def test_columns_come_in_the_order_asked_for_or_all_and_empty_rows_are_left_out(tmp_path):
    table = read(tmp_path, "\ufeffa, b,note\n1,2,x\n\n3,-4e1,y\n", {"b": 50.0, "a": 5.0})
    assert table.values.tolist() == [[2.0, 1.0], [-40.0, 3.0]]
    assert table.rows.lines == [2, 4]
    table = read(tmp_path, "a,b\n1,2\n")
    assert (table.names, table.values.tolist()) == (("a", "b"), [[1.0, 2.0]])


@pytest.mark.parametrize(
    ("text", "wanted", "place", "found"),
    [
        ("a,c\n1,2\n", ("a", "b"), (1, None), "no column b"),
        ("a,a\n1,2\n", ("a",), (1, None), "the column a twice"),
        ("a,b\n1,2\n1,x y\n", ("a", "b"), (3, 3), "'x y'"),
        ("a,b\n1,-101\n", ("b",), (2, 3), "-101"),
        ("a,b\n1,nan\n", ("b",), (2, 3), "'nan'"),
        ("a,b\n1,2,3\n", None, (2, None), "3 cells"),
        ("", ("a",), (1, None), "no rows"),
        (b"a\n\xff\n", ("a",), (None, None), "utf-8"),
        ('a\n1\n"' + "x" * 200_000 + '"\n', ("a",), (3, None), "field limit"),
    ],
)
def test_a_mistake_is_said_with_its_place(tmp_path, text, wanted, place, found):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, wanted and dict.fromkeys(wanted, 100.0))
    assert (caught.value.line, caught.value.column) == place
    assert found in caught.value.found


def test_numbers_that_do_not_rise_are_found_in_the_file(tmp_path):
    table = read(tmp_path, "word,time_s\n'a',0\n\nbb,2\nccc,2\n", {"time_s": 10.0})
    with pytest.raises(InputError, match=r"the time 2 s; expected times that rise") as caught:
        table.check_rising("time_s", "s")
    assert (caught.value.line, caught.value.column) == (5, 5)


NUMBERS = [
    np.array([1.5, np.nan, -0.0]),
    np.arange(4),
    np.array([1.5, 2.5], np.float32),
    np.empty(0),
    np.eye(3)[:, 1],
]


@pytest.mark.parametrize(
    "values", NUMBERS, ids=["floats", "integers", "singles", "empty", "strided"]
)
def test_numbers_become_a_column_and_come_back(values):
    column = number_column(values)
    column.validate(full=True)
    assert column.type == pa.array(values).type
    for chunks in ([], [column], [column, column.slice(1, 1)]):
        chunked = pa.chunked_array(chunks, column.type)
        found = column_values(chunked)
        assert found.dtype == values.dtype
        assert np.array_equal(found, chunked.to_numpy(), equal_nan=values.dtype.kind == "f")
    assert np.array_equal(
        column_values(pa.chunked_array([pa.array([1.5, None]), [2.0]])), [1.5, np.nan, 2.0], True
    )


@pytest.mark.parametrize("texts", [["ok", "", "ground", "ok"], ["größer", "α"], []])
def test_texts_become_a_column_and_come_back(texts):
    column = text_column(texts)
    column.validate(full=True)
    assert column.equals(pa.array(texts, pa.string()))
    names, which = distinct_texts(pa.chunked_array([column]))
    assert [names[i] for i in which] == texts and names == sorted(set(texts))


def test_no_column_imports_pandas():
    code = """
import sys, numpy as np, pyarrow as pa
from abhv_mc.io.parquet_columns import *
table = pa.table([number_column(np.arange(3.0)), text_column(["a", "b", "a"])], names=["x", "name"])
column_values(table["x"]), distinct_texts(table["name"])
assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a/b.txt"
    with atomic_write(path, durable=True) as temporary:
        temporary.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    with pytest.raises(TypeError), atomic_write(path) as temporary:
        temporary.write_text(3)
    assert path.read_text() == "new" and list(path.parent.iterdir()) == [path]
