"""Files of histories, nominal flights, the reference and envelopes, cell by cell."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from abhv_mc.flights.signals import Signal
from abhv_mc.folder.histories import (
    QUANTILE_COLUMNS,
    EnvelopeTable,
    write_envelopes,
    write_histories,
    write_nominal,
    write_reference,
)

SIGNALS = tuple(Signal(name, unit, f"doc of {name}") for name, unit in (("a_m", "m"), ("b", "-")))
TIMES = np.array([0.0, 0.5, 1.0])


def read(path):
    table = pq.read_table(path)
    metadata = {key.decode(): text.decode() for key, text in (table.schema.metadata or {}).items()}
    return table, metadata


def test_histories_have_rows_until_the_end_of_each_flight(tmp_path):
    history = np.arange(12, dtype=np.float32).reshape(2, 3, 2)
    history[1, 2] = np.nan
    history[0, 1, 1] = np.nan  # a sample of the second channel only
    path = tmp_path / "a.parquet"
    entries = {"channels": ("b", "a_m"), "metadata": {"key": "k"}, "recorded": SIGNALS}
    write_histories(path, "one", [7, 40], TIMES, history, **entries)
    table, metadata = read(path)
    columns = table.to_pydict()
    assert [*columns] == ["flight", "controller", "time", "b", "a_m"]
    assert columns["flight"] == [7, 7, 7, 40, 40] and set(columns["controller"]) == {"one"}
    assert columns["time"] == [0.0, 0.5, 1.0, 0.0, 0.5]
    assert columns["a_m"] == [0.0, 2.0, 4.0, 6.0, 8.0]
    assert columns["b"][::2] == [1.0, 5.0, 9.0] and np.isnan(columns["b"][1])
    assert metadata["abhv_mc.key"] == "k" and table.schema.field("a_m").metadata[b"unit"] == b"m"


def test_nominal_flights_end_with_their_first_channel(tmp_path):
    nominal = {name: np.full((3, 2), k + 1.0, np.float32) for k, name in enumerate(("x", "y"))}
    nominal["x"][2] = np.nan
    nominal["y"][0, 1] = 9.0
    write_nominal(tmp_path / "n.parquet", TIMES, nominal, SIGNALS, "x y")
    table, metadata = read(tmp_path / "n.parquet")
    assert table.to_pydict() == {
        "controller": ["x", "x", "y", "y", "y"],
        "time": [0.0, 0.5, 0.0, 0.5, 1.0],
        "a_m": [1.0, 1.0, 2.0, 2.0, 2.0],
        "b": [1.0, 1.0, 9.0, 2.0, 2.0],
    }
    assert metadata["abhv_mc.key"] == "x y"
    reference = {"b": TIMES + 2.0, "a_m": TIMES + 1.0, "time": TIMES}
    write_reference(tmp_path / "r.parquet", reference, SIGNALS)
    table, metadata = read(tmp_path / "r.parquet")
    assert table.column_names == ["time", "a_m", "b"] and "abhv_mc.key" not in metadata
    assert {name: column.tolist() for name, column in reference.items()} == table.to_pydict()


@pytest.mark.parametrize("points", [1, 3])
def test_envelopes_have_a_row_for_each_controller_channel_and_time(tmp_path, points):
    def make(start):
        cells = start + np.arange(6.0).reshape(3, 2)  # [time, channel]
        edges = np.stack([cells + 10.0 * k for k in range(1, 6)])
        return EnvelopeTable(cells.astype(int), cells, cells + 99.0, edges, edges + 0.5)

    tables = {"one": make(0.0), "two": make(1000.0)}
    path = tmp_path / "e.parquet"
    write_envelopes(path, TIMES, ("a_m", "b"), tables, 40, points=points, key="k")
    table, metadata = read(path)
    columns = table.to_pydict()
    most = ["q50_most"] if points > 1 else []
    names = ["controller", "channel", "time", "count", "min", *QUANTILE_COLUMNS, "max", *most]
    assert [*columns] == names
    assert columns["controller"] == ["one"] * 6 + ["two"] * 6
    assert columns["channel"] == ["a_m"] * 3 + ["b"] * 3 + ["a_m"] * 3 + ["b"] * 3
    assert columns["time"] == [*TIMES] * 4
    low = np.array([0, 2, 4, 1, 3, 5, 1000, 1002, 1004, 1001, 1003, 1005])
    assert columns["count"] == low.tolist() and columns["min"] == low.tolist()
    assert columns["max"] == (low + 99.0).tolist()
    for k, name in enumerate(QUANTILE_COLUMNS):
        assert columns[name] == (low + 10.0 * (k + 1) + 0.5 * (k > 2)).tolist()
    assert all(columns[name] == (low + 30.5).tolist() for name in most)
    assert metadata["flights"] == "40" and metadata["abhv_mc.key"] == "k"
    selected = tables["one"].at(np.array([True, False, True]))
    assert selected.count.tolist() == [[0, 1], [4, 5]] and selected.high[1, 0] == 103.0
    assert selected.low[1, 1] == 5.0 and selected.least[2, 1, 0] == 34.0
    assert selected.most[:, 0, 1].tolist() == [11.5, 21.5, 31.5, 41.5, 51.5]
