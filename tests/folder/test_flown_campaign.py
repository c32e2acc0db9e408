"""What is read of a flown folder: the flights of each controller, samples, histories."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from report.synthetic import CONTROLLERS, write_campaign

from abhv_mc.bounds import Bounds
from abhv_mc.flight.metrics import METRICS
from abhv_mc.folder.controller_flights import read_flights
from abhv_mc.folder.flown_campaign import read_flown, read_histories
from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.io.documents import InputError


def test_a_folder_reads_as_arrays(failing):
    assert failing.controllers == CONTROLLERS
    assert len(failing.metrics) == len(METRICS)
    assert failing.flights["lqr"].flight.tolist() == list(range(100))
    assert failing.flights["lqr"].failed.sum() == 12
    assert not failing.flights["tlc"].failed.any()
    density = failing.samples["atmosphere.density"]
    assert set(np.argsort(density)[-12:]) == set(np.flatnonzero(failing.flights["lqr"].failed))
    requirement = failing.campaign.requirements[0]
    assert (requirement.limits, requirement.controllers) == (Bounds(high=50.0), ("tlc",))
    assert requirement.early_is_failure


def test_histories_are_those_kept(failing_folder):
    kept = read_histories(failing_folder, "lqr")
    assert len(kept) == 20
    assert all(len(history["time"]) == 601 for history in kept.values())


def test_a_shard_is_no_campaign_yet(tmp_path):
    folder = write_campaign(tmp_path / "c", runs=4)
    path = folder / "manifest.json"
    write_manifest(path, replace(read_manifest(path), shard=(1, 3)))
    with pytest.raises(InputError, match="shard 1/3 of a campaign"):
        read_flown(folder)


def write_flights(path, flight, controller, outcome=None, **columns):
    table = {"flight": flight, "controller": controller, "outcome": outcome or ["ok"] * len(flight)}
    values = {"aero.lift": np.ones(len(flight)), "a_m": np.asarray(flight, float), "end_time_s": np.ones(len(flight))}
    pq.write_table(pa.table(table | values | columns), path)


def test_flights_ascend_whatever_the_order_of_their_blocks(tmp_path):
    write_flights(tmp_path / "1.parquet", [4, 2, 3], ["x", "x", "y"])
    write_flights(tmp_path / "2.parquet", [1, 3, 5], ["x", "x", "y"], ["ok", "altitude_limit", "ok"])
    found = read_flights(tmp_path)
    assert list(found) == ["x", "y"]
    assert found["x"].flight.tolist() == [1, 2, 3, 4]
    assert found["x"].metrics["a_m"].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert found["x"].failed.tolist() == [False, False, True, False]
    assert found["x"].count_outcomes() == {"altitude_limit": 1, "ok": 3}
    assert found["y"].metrics["a_m"].tolist() == [3.0, 5.0]
    assert list(found["x"].metrics) == ["a_m", "end_time_s"]  # no samples


def test_only_computed_flights_have_metrics(tmp_path):
    write_flights(tmp_path / "1.parquet", [0, 1, 2], ["x"] * 3, ["ok", "failed_to_run", "sideslip_limit"])
    write_flights(tmp_path / "2.parquet", [0], ["y"], ["failed_to_run"])
    (flights,) = read_flights(tmp_path).values()
    assert flights.flight.tolist() == [0, 2] and flights.not_computed == 1
    assert flights.metrics["a_m"].tolist() == [0.0, 2.0]


@pytest.mark.parametrize("outcome", [["failed_to_run"], None])
def test_a_folder_without_a_computed_flight_is_bad_input(tmp_path, outcome):
    if outcome:
        write_flights(tmp_path / "1.parquet", [0], ["x"], outcome)
    with pytest.raises(InputError):
        read_flights(tmp_path)
