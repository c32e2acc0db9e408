"""Envelope states on disk may be anybody's, as shards are: compiled code follows their bins without a look."""

import numpy as np
import pytest

from abhv_mc.execution.fly_batches import fly_counted
from abhv_mc.flight.plan import FlightBlock
from abhv_mc.folder.arrays import write_array
from abhv_mc.folder.envelope_states import EXACT_FLIGHTS, Cells, make_collector, merge_states

CELLS = Cells(("altitude_m", "speed_mps"), (0, 1), np.arange(3.0), 1)
HISTORY = np.random.default_rng(3).normal(size=(64, CELLS.count)).astype(np.float32)


def collect(folder, flights=EXACT_FLIGHTS + 1):
    return make_collector(folder, "one", flights, CELLS, lambda number: HISTORY[:number], 64)


def counted(recorded):
    """The flights of HISTORY, as a worker counts them."""
    flown = FlightBlock(
        np.zeros(64, np.int64), np.zeros(64), np.zeros((64, 1)), HISTORY.reshape(64, 3, 2), np.arange(3.0)
    )
    return fly_counted(lambda *_: flown, None, np.zeros((64, 1)), recorded)


@pytest.fixture
def state(tmp_path):
    collector = collect(tmp_path / "states")
    collector.add(0, counted(collector.recorded))
    collector.save()
    path = tmp_path / "states/one.npz"
    with np.load(path) as stored:
        return path, dict(stored)


DAMAGES = {
    "edges that are no numbers": lambda s: {"low": np.full_like(s["low"], np.nan)},
    "bins without a width": lambda s: {"width": np.zeros_like(s["width"])},
    "fewer bins": lambda s: {"counts": s["counts"][:, :5]},
    "other types": lambda s: {"counts": s["counts"].astype(str)},
    "flights that are no number": lambda s: {"flights": np.asarray(np.nan)},
    "nothing": lambda s: {"low": None},
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_state_that_no_campaign_wrote_is_begun_anew(state, tmp_path, damage):
    path, parts = state
    parts |= DAMAGES[damage](parts)
    np.savez(path, **{name: value for name, value in parts.items() if value is not None})
    collector = collect(path.parent)
    assert not collector.covered.any()
    collector.add(0, counted(collector.recorded))
    np.savez(path, **{name: value for name, value in parts.items() if value is not None})
    merge_states([path.parent], tmp_path / "merged")
    assert not (tmp_path / "merged/one.npz").exists()


def test_a_state_comes_back(state):
    assert collect(state[0].parent).covered.sum() == 64


@pytest.mark.parametrize(
    "values", [np.zeros((66, 6)), np.zeros((66, 6), "<U3"), np.zeros((66, 5), np.float32), np.zeros(66, np.float32)]
)
def test_a_block_of_another_type_or_shape_is_left_out(tmp_path, values):
    write_array(tmp_path / "blocks/one-000000000-000000064.npy", values)
    assert not collect(tmp_path, 64).covered.any()


def test_a_block_beyond_the_campaign_is_left_out(tmp_path):
    write_array(tmp_path / "blocks/one-000000000-000000064.npy", np.zeros((66, 6), np.float32))
    assert not collect(tmp_path, 63).covered.any() and collect(tmp_path, 64).covered.all()
