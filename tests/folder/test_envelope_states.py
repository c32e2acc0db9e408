"""Stored values of envelopes: each flight counts once."""

import numpy as np
import pytest

from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.folder.envelope_states import Cells, Collector, merge_states
from abhv_mc.folder.histories import EnvelopeTable
from abhv_mc.io.messages import InputError
from abhv_mc.statistics.bands import QUANTILES


def test_overlapping_blocks_count_each_flight_once(tmp_path):
    """Blocks of different sizes overlap after a run was resumed."""
    times = np.arange(3.0)
    cells = Cells(("height",), (0,), 1, times)
    collector = Collector(tmp_path, "one", np.zeros(6, bool), cells)
    for first, stop in ((0, 4), (2, 6)):
        flights = np.arange(first, stop)
        history = np.repeat(flights**2.0, 3).reshape(-1, 3, 1).astype(np.float32)
        low, high = history.min(axis=0), history.max(axis=0)
        rows = np.zeros(len(flights), np.uint8), np.ones(len(flights)), np.empty((len(flights), 0))
        collector.add(first, FlightBlock(*rows, history, times, low=low, high=high))
    table = Collector(tmp_path, "one", np.ones(6, bool), cells).table(times)
    assert table.count.tolist() == [[6]] * 3 and collector.covered.all()
    assert table.least[2].tolist() == [[6.5]] * 3  # median of 0, 1, 4, 9, 16 and 25
    assert (table.low.max(), table.high.min()) == (0.0, 25.0)


def test_quantiles_up_to_the_median_are_the_lower_edges():
    edges = np.arange(5.0)[:, None, None]
    columns = EnvelopeTable(np.ones((1, 1)), edges[0], edges[4], edges, edges + 9.0).columns(2)
    assert [column.item() for column in columns.values()] == [0, 0, 1, 2, 12, 13, 4, 11]


def add_all(collector, history, times, *ranges):
    """Store ranges of flights [flight, time, channel], with extremes beyond their samples by 1."""
    for first, stop in ranges:
        own = history[first:stop]
        rows = np.zeros(len(own), int), np.ones(len(own)), np.empty((len(own), 0))
        low, high = np.fmin.reduce(own, axis=0) - 1.0, np.fmax.reduce(own, axis=0) + 1.0
        collector.add(first, FlightBlock(*rows, own, times, low=low, high=high))


@pytest.mark.parametrize("points", [1, 3])
def test_envelopes_are_quantiles_at_each_point_and_of_angles_about_their_mean(tmp_path, points):
    """Headings are within 20 deg of north; flight 4 ended after the first time."""
    draw, times = np.random.default_rng(3), np.arange(2.0)
    history = draw.uniform(-20.0, 20.0, (12, 2, 2)).astype(np.float32)
    history[4, 1] = np.nan
    around = history.copy()
    around[:, :, 1] %= 360.0
    cells = Cells(("height", "heading"), (0, 1), 1, times, points, {"heading": 360.0, "height": 0})
    collector = Collector(tmp_path / "a", "one", np.zeros(12, bool), cells)
    add_all(collector, around, times, (0, 5), (5, 12))
    table = collector.table(times)
    assert table.count.tolist() == [[12, 12], [11, 11]]
    np.testing.assert_allclose(table.low[:, 0], np.nanmin(history[:, :, 0], axis=0) - 1.0)
    np.testing.assert_allclose(table.high[:, 0], np.nanmax(history[:, :, 0], axis=0) + 1.0)
    turned = table.low[0, 1] - history[:, 0, 1].min()
    assert turned / 360.0 == pytest.approx(np.round(turned / 360.0), abs=1e-6)
    moved = history.astype(float)
    moved[:, :, 1] += turned
    np.testing.assert_allclose(table.low[:, 1], np.nanmin(moved[:, :, 1], axis=0), rtol=1e-5)
    np.testing.assert_allclose(table.high[:, 1], np.nanmax(moved[:, :, 1], axis=0), rtol=1e-5)
    at_points = [np.nanquantile(moved[k::points], QUANTILES, axis=0) for k in range(points)]
    np.testing.assert_allclose(table.least, np.min(at_points, axis=0), rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(table.most, np.max(at_points, axis=0), rtol=1e-4, atol=1e-4)


def test_blocks_with_times_of_their_own_are_placed_on_the_common_times(tmp_path):
    """Blocks of shards are merged; only intact blocks of stored flights count."""
    cells = Cells(("height",), (0,), 1)
    flown = np.arange(8) != 7
    parts = [Collector(tmp_path / name, "one", np.zeros(8, bool), cells) for name in "ab"]
    for part, ends, start in zip(parts, ((0, 3), (3, 8)), (1.0, 2.0), strict=True):
        history = np.broadcast_to(np.arange(8.0, dtype=np.float32)[:, None, None], (8, 2, 1))
        add_all(part, history, start + np.arange(2.0), ends)
        assert np.flatnonzero(part.covered).tolist() == [*range(*ends)]
    merge_states([tmp_path / "a", tmp_path / "b"], tmp_path / "c")
    blocks = tmp_path / "c/blocks"
    (blocks / "one-000000000-000000009.npy").write_bytes(b"x")
    (blocks / "one-new-000000000-000000003.npy").write_bytes(b"x")
    merged = Collector(tmp_path / "c", "one", flown, cells)
    assert merged.covered.tolist() == flown.tolist()
    assert merged.times.tolist() == [1.0, 2.0, 3.0]
    table = merged.table(np.arange(4.0))
    assert table.count.ravel().tolist() == [0, 3, 8, 5]
    np.testing.assert_array_equal(table.low.ravel(), [np.nan, -1.0, -1.0, 2.0])
    np.testing.assert_array_equal(table.high.ravel(), [np.nan, 3.0, 8.0, 8.0])
    np.testing.assert_array_equal(table.most[2].ravel(), [np.nan, 1.0, 3.5, 5.0])
    (blocks / "one-000000000-000000003.npy").unlink()
    with pytest.raises(InputError):
        merged.table(np.arange(4.0))
    merged.finish()
    assert not (tmp_path / "c").exists()
