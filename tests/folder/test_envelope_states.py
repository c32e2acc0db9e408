"""Stored values of envelopes: each flight counts once."""

import numpy as np

from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.folder.envelope_states import Cells, Collector
from abhv_mc.folder.histories import EnvelopeTable


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
