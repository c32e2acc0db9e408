import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from abhv_mc.folder.controller_flights import read_flights
from abhv_mc.io.documents import InputError


def write(path, flight, controller, outcome=None, **columns):
    table = {"flight": flight, "controller": controller, "outcome": outcome or ["ok"] * len(flight)}
    values = {"aero.lift": np.ones(len(flight)), "a_m": np.asarray(flight, float), "end_time_s": np.ones(len(flight))}
    pq.write_table(pa.table(table | values | columns), path)


def test_flights_ascend_whatever_the_order_of_their_blocks(tmp_path):
    write(tmp_path / "1.parquet", [4, 2, 3], ["x", "x", "y"])
    write(tmp_path / "2.parquet", [1, 3, 5], ["x", "x", "y"], ["ok", "altitude_limit", "ok"])
    found = read_flights(tmp_path)
    assert list(found) == ["x", "y"]
    assert found["x"].flight.tolist() == [1, 2, 3, 4]
    assert found["x"].metrics["a_m"].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert found["x"].failed.tolist() == [False, False, True, False]
    assert found["x"].count_outcomes() == {"altitude_limit": 1, "ok": 3}
    assert found["y"].metrics["a_m"].tolist() == [3.0, 5.0]
    assert list(found["x"].metrics) == ["a_m", "end_time_s"]  # no samples


def test_only_computed_flights_have_metrics(tmp_path):
    write(tmp_path / "1.parquet", [0, 1, 2], ["x"] * 3, ["ok", "failed_to_run", "sideslip_limit"])
    write(tmp_path / "2.parquet", [0], ["y"], ["failed_to_run"])
    (flights,) = read_flights(tmp_path).values()
    assert flights.flight.tolist() == [0, 2] and flights.not_computed == 1
    assert flights.metrics["a_m"].tolist() == [0.0, 2.0]


@pytest.mark.parametrize("outcome", [["failed_to_run"], None])
def test_a_folder_without_a_computed_flight_is_bad_input(tmp_path, outcome):
    if outcome:
        write(tmp_path / "1.parquet", [0], ["x"], outcome)
    with pytest.raises(InputError):
        read_flights(tmp_path)
