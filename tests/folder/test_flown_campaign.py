"""Tests of reading a campaign's folder: flights of each controller, samples and histories."""

import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from report.synthetic import CONTROLLERS, write_campaign

from abhv_mc.bounds import Bounds
from abhv_mc.flights.metrics import MARGIN_FAULTS, MARGIN_NAMES
from abhv_mc.folder import file_columns, flights
from abhv_mc.folder.controller_flights import read_flights
from abhv_mc.folder.file_columns import SpooledColumns
from abhv_mc.folder.flights import SampleReader, write_samples
from abhv_mc.folder.flown_campaign import (
    BANDS,
    Envelope,
    FlownCampaign,
    _read_envelopes,
    read_flown,
    read_histories,
    read_replayed,
)
from abhv_mc.folder.histories import QUANTILE_COLUMNS
from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.metrics import METRICS
from abhv_mc_vehicle.plant.parameters import OURS


def test_a_folder_reads_as_arrays(failing, failing_folder):
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
    histories = read_histories(failing_folder, "lqr")
    assert len(histories) == 20 and all(
        len(history["time"]) == 601 for history in histories.values()
    )


def test_a_shard_is_not_read_as_a_campaign(tmp_path):
    folder = write_campaign(tmp_path / "c", runs=4)
    path = folder / "manifest.json"
    write_manifest(path, replace(read_manifest(path), shard=(1, 3)))
    with pytest.raises(InputError, match="shard 1/3"):
        read_flown(folder)


def write_flights(path, flight, controller, outcome=None):
    table = {"flight": flight, "controller": controller, "outcome": outcome or ["ok"] * len(flight)}
    values = {
        "reason": [""] * len(flight),
        "aero.lift": np.ones(len(flight)),
        "a_m": np.asarray(flight, float),
        "end_time_s": np.ones(len(flight)),
    }
    pq.write_table(pa.table(table | values), path)


def test_computed_flights_ascend_whatever_the_order_of_their_blocks(tmp_path):
    with pytest.raises(InputError):
        read_flights(tmp_path)
    write_flights(tmp_path / "0.parquet", [0], ["z"], ["failed_to_run"])
    with pytest.raises(InputError):
        read_flights(tmp_path)
    write_flights(tmp_path / "1.parquet", [4, 2, 3], ["x", "x", "y"])
    ends = ["ok", "failed_to_run", "altitude_limit", "ok"]
    write_flights(tmp_path / "2.parquet", [1, 0, 3, 5], ["x", "x", "x", "y"], ends)
    flights = read_flights(tmp_path)
    assert list(flights) == ["x", "y"]
    assert flights["x"].flight.tolist() == [1, 2, 3, 4] and flights["x"].not_computed == 1
    assert flights["x"].metrics["a_m"].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert flights["x"].failed.tolist() == [False, False, True, False]
    assert flights["x"].count_outcomes() == {"altitude_limit": 1, "ok": 3}
    assert flights["y"].metrics["a_m"].tolist() == [3.0, 5.0]
    assert list(flights["x"].metrics) == ["a_m", "end_time_s"]  # no samples


@pytest.mark.parametrize("limit", [1 << 20, 1000])  # in memory, and in a temporary file
def test_spooled_columns_are_exact_and_in_the_requested_order(monkeypatch, limit):
    monkeypatch.setattr(file_columns, "_IN_MEMORY", limit)
    monkeypatch.setattr(file_columns, "_CHUNK", 100)
    table = np.random.default_rng(1).normal(size=(3, 457))
    table[1, 5], table[2, 6] = np.nan, -np.inf
    spooled = SpooledColumns(["a", "b", "c"])
    start = 0
    for rows in (1, 99, 0, 150, 7, 200):
        spooled.append(table[:, start : start + rows])
        start += rows
        np.testing.assert_array_equal(spooled["b"], table[1, :start])
    assert spooled._file._rolled == (limit == 1000)
    order = np.random.default_rng(2).permutation(457)
    spooled.put_in_order(order)
    for name, column in zip("abc", table, strict=True):
        np.testing.assert_array_equal(spooled[name], column[order])
    assert list(spooled) == ["a", "b", "c"] and "d" not in spooled


def test_threads_in_different_groups_of_samples_get_their_own_rows(tmp_path, monkeypatch):
    """One thread starts blocks and another stores them, possibly a group later."""
    monkeypatch.setattr(flights, "ROW_GROUP", 64)

    def draw(first, stop):
        return np.arange(first, stop)[:, None] + np.array([0.0, 0.25])

    write_samples(
        tmp_path / "samples.parquet", ("aero.lift", "aero.drag"), 1000, draw, {}, table=OURS
    )
    reader, wrong = SampleReader(tmp_path / "samples.parquet"), []
    for first, stop in [(0, 1000), (999, 1000), (5, 5)]:
        np.testing.assert_array_equal(reader.rows(first, stop), draw(first, stop))
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)

    def read(first):
        for _ in range(3000):
            if not np.array_equal(reader.rows(first, first + 16), draw(first, first + 16)):
                wrong.append(first)

    threads = [threading.Thread(target=read, args=(first,)) for first in (48, 64, 512, 0)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    sys.setswitchinterval(interval)
    assert not wrong


@pytest.mark.parametrize(("with_margins", "has_margins"), [(40, True), (39, False)])
def test_margins_are_metrics_if_all_flights_have_them(with_margins, has_margins):
    margin, fault = MARGIN_NAMES[0], MARGIN_FAULTS[0].name
    stored = SimpleNamespace(metrics=dict.fromkeys((fault, "end_time_s", margin, "b", "a")))
    metrics = {name: SimpleNamespace(group="usage" * (name == "b")) for name in ("a", "b", margin)}
    campaign = SimpleNamespace(
        margin_flights=with_margins, runs=40, asked=("a", margin, "absent"), metrics=metrics
    )
    results = FlownCampaign(Path(), campaign, None, {}, {"one": stored}, {}, {}, {})
    required = ("a", *[margin] * has_margins)
    assert results.asked == required
    assert results.metrics == results.compared == (*required, "b")


def test_angles_are_turned_to_the_known_part_of_the_envelope():
    median = np.array([350.0, 360.0, 370.0, np.nan])
    envelopes = {("a", "heading_deg"): SimpleNamespace(time=np.arange(4.0), median=median)}
    periods = {"heading_deg": 360.0}
    results = SimpleNamespace(envelopes=envelopes, campaign=SimpleNamespace(periods=periods))
    curves = {"time": np.arange(4.0), "speed_mps": np.arange(4.0)}
    curves["heading_reference_deg"] = np.array([-10.0, 0.0, 10.0, 20.0])
    aligned = FlownCampaign.align(results, "a", curves)
    assert aligned["heading_reference_deg"].tolist() == [350.0, 360.0, 370.0, 380.0]
    assert FlownCampaign.align(results, "b", curves) == curves
    median[:] = np.nan
    assert FlownCampaign.align(results, "a", curves) == curves


def test_a_replayed_flight_belongs_to_the_controller_of_its_file(failing_folder, tmp_path):
    stored = read_histories(failing_folder, "lqr")
    table = pq.read_table(failing_folder / "histories")
    for number in sorted(stored)[:2]:
        rows = pc.and_(pc.equal(table["controller"], "lqr"), pc.equal(table["flight"], number))
        path = tmp_path / f"lqr-new-{number:06d}.parquet"
        pq.write_table(table.filter(rows), path)
        name, flight, history = read_replayed(path)
        assert (name, flight) == ("lqr-new", number) and history.keys() == stored[number].keys()
        for key, values in history.items():
            np.testing.assert_array_equal(values, stored[number][key])


def test_the_metrics_of_a_campaign_are_ordered_and_those_compared_include_control_effort():
    """Margins of only some flights are no metrics."""
    margin, fault = MARGIN_NAMES[0], MARGIN_FAULTS[0].name
    groups = {"range": "error", "effort": "usage", "miss": "error", margin: "usage"}
    metrics = {name: SimpleNamespace(group=group) for name, group in groups.items()}
    stored = SimpleNamespace(metrics=["miss", "range", "end_time_s", margin, fault, "effort"])
    campaign = SimpleNamespace(
        metrics=metrics,
        asked=("miss", "absent", margin),
        margin_flights=5,
        runs=6,
        controllers=("c", "b", "a"),
        parameters={name: SimpleNamespace(seed=name == "noise") for name in ("lift", "noise")},
    )
    samples = {"lift": np.zeros(2), "noise": np.zeros(2)}
    parts = None, campaign, None, samples, {"a": stored, "c": stored}, {}, {}, {}
    results = FlownCampaign(*parts)
    assert results.controllers == ("c", "a") and list(results.pairs) == [("a", "c")]
    assert results.dispersed == ("lift",)
    assert results.metrics == ("miss", "range", "effort") and results.asked == ("miss",)
    assert results.compared == ("miss", "effort")
    campaign.margin_flights = 6
    assert results.metrics == ("miss", margin, "range", "effort")
    assert results.asked == ("miss", margin) and results.compared == ("miss", margin, "effort")


def test_references_are_moved_by_turns_to_the_median_of_their_envelope():
    """The curve is interpolated where the median exists; other channels stay."""
    time = np.array([0.0, 1.0, 2.0, 3.0])
    lower = np.array([350.0, 370.0, np.nan, 374.0])
    bands = {"q50": lower, "q50_most": lower + 4.0}
    envelope = Envelope(time, np.ones(4, int), bands)
    np.testing.assert_array_equal(envelope.median, lower + 2.0)
    np.testing.assert_array_equal(Envelope(time, time, {"q50": lower}).median, lower)
    campaign = SimpleNamespace(periods={"heading_deg": 360.0, "height_m": 0.0})
    cells = {("a", name): envelope for name in ("heading_deg", "height_m")}
    results = FlownCampaign(None, campaign, None, {}, {}, cells, {}, {})
    curves = {
        "time": np.array([0.0, 0.5, 2.0]),
        "heading_deg_reference": np.array([-5.0, 2.0, 13.0]),
        "heading_deg": np.array([1.0, 1.0, 1.0]),
        "height_m": np.array([1.0, 2.0, 3.0]),
    }
    aligned = results.align("a", curves)
    assert aligned["heading_deg_reference"].tolist() == [355.0, 362.0, 373.0]
    assert aligned["heading_deg"].tolist() == [361.0] * 3
    assert aligned["height_m"] is curves["height_m"] and aligned["time"] is curves["time"]
    assert results.align("b", curves) == curves


def test_envelopes_are_read_by_controller_and_channel_in_order_of_time(tmp_path):
    """Each cell is controller, channel and time; the rows of a file may have any order."""
    names = ("min", *QUANTILE_COLUMNS, "max")
    rows = [(c, h, t) for c in range(2) for h in range(2) for t in range(3)]
    numbers = np.array([100.0 * c + 10.0 * h + t for c, h, t in rows])
    table = pa.table(
        {
            "controller": [("one", "two")[c] for c, *_ in rows],
            "channel": [("a_m", "b")[h] for _, h, _ in rows],
            "time": [0.5 * t for *_, t in rows],
            "count": numbers.astype(int),
            **{name: numbers + 0.1 * k for k, name in enumerate(names)},
        }
    )
    path = tmp_path / "e.parquet"
    pq.write_table(table.take(np.random.default_rng(0).permutation(12)), path)
    cells = _read_envelopes(path)
    assert {*cells} == {(c, h) for c in ("one", "two") for h in ("a_m", "b")}
    for (controller, channel), cell in cells.items():
        start = 100.0 * (controller == "two") + 10.0 * (channel == "b")
        assert cell.time.tolist() == [0.0, 0.5, 1.0]
        assert cell.count.tolist() == [start, start + 1, start + 2]
        assert [*cell.bands] == [*BANDS]
        for k, name in enumerate(names):
            assert cell.bands[name] == pytest.approx(start + np.arange(3.0) + 0.1 * k)
