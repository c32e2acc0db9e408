"""Columns that are assembled from pieces."""

import numpy as np

from abhv_mc.folder import file_columns
from abhv_mc.folder.file_columns import SpooledColumns


def test_pieces_of_a_table_are_written_together_and_read_by_column(monkeypatch):
    monkeypatch.setattr(file_columns, "_CHUNK", 5)
    table = np.arange(24.0).reshape(2, 12)
    columns = SpooledColumns(["a", "b"])
    for piece in np.split(table, (2, 4, 5, 11), axis=1):
        columns.append(piece)
    assert columns._chunks == [5, 6] and len(columns._waiting) == 1
    assert columns["b"].tolist() == table[1].tolist()
    columns.append(table[:, :1])
    assert columns["a"].tolist() == [*table[0], 0.0]
    order = np.arange(13)[::-1]
    columns.put_in_order(order)
    assert columns["b"].tolist() == [12.0, *table[1, ::-1]]
    assert [*columns] == ["a", "b"] and "c" not in columns
