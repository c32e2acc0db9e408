import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from abhv_mc.folder import file_columns
from abhv_mc.folder.file_columns import FileColumns, SpooledColumns
from abhv_mc.io.documents import InputError


@pytest.mark.parametrize("held", [1 << 20, 1000])  # in memory, and in a temporary file
def test_a_spooled_column_comes_back_to_the_last_bit(monkeypatch, held):
    monkeypatch.setattr(file_columns, "_HELD", held)
    monkeypatch.setattr(file_columns, "_CHUNK", 100)
    table = np.random.default_rng(1).normal(size=(3, 457))
    table[1, 5], table[2, 6] = np.nan, -np.inf
    spooled = SpooledColumns(["a", "b", "c"])
    start = 0
    for rows in (1, 99, 0, 150, 7, 200):
        spooled.append(table[:, start : start + rows])
        start += rows
    np.testing.assert_array_equal(spooled["b"], table[1])
    assert spooled._file._rolled == (held == 1000)
    np.testing.assert_array_equal(spooled["a"], table[0])
    np.testing.assert_array_equal(spooled["c"], table[2])
    assert list(spooled) == ["a", "b", "c"] and "d" not in spooled


def test_rows_can_be_added_after_a_column_was_read_and_put_in_order(monkeypatch):
    monkeypatch.setattr(file_columns, "_CHUNK", 2)
    spooled = SpooledColumns(["a", "b"])
    spooled.append(np.array([[3.0], [30.0]]))
    assert spooled["b"].tolist() == [30.0]
    spooled.append(np.array([[1.0, 2.0], [10.0, 20.0]]))
    spooled.put_in_order(np.array([1, 2, 0]))
    assert spooled["a"].tolist() == [1.0, 2.0, 3.0]
    assert spooled["b"].tolist() == [10.0, 20.0, 30.0]


def test_columns_of_a_file_are_read_when_asked_for(tmp_path):
    path = tmp_path / "samples.parquet"
    pq.write_table(pa.table({"flight": [0, 1], "x": [0.1, 0.2], "y": [1, 2]}), path)
    found = FileColumns(path, "samples", without=("flight",))
    assert list(found) == ["x", "y"] and "flight" not in found
    assert found["x"].tolist() == [0.1, 0.2]
    assert found["y"].dtype == np.float64
    with pytest.raises(KeyError):
        found["flight"]
    path.unlink()
    with pytest.raises(InputError, match=r"samples\.parquet"):
        found["x"]
