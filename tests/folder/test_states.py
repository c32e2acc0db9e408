"""Values of envelopes on disk may be anybody's, as shards are: only whole blocks of this campaign are taken."""

import numpy as np
import pytest

from abhv_mc.folder.arrays import write_array
from abhv_mc.folder.envelope_states import Cells, Collector

CELLS = Cells(("altitude_m", "speed_mps"), (0, 1), 1, np.arange(3.0))


def collect(folder, flights):
    return Collector(folder, "one", np.ones(flights, bool), CELLS)


@pytest.mark.parametrize(
    "values", [np.zeros((68, 6)), np.zeros((68, 6), "<U3"), np.zeros((68, 5), np.float32), np.zeros(68, np.float32)]
)
def test_a_block_of_another_type_or_shape_is_left_out(tmp_path, values):
    write_array(tmp_path / "blocks/one-000000000-000000064.npy", values)
    assert not collect(tmp_path, 64).covered.any()


def test_a_block_beyond_the_campaign_is_left_out(tmp_path):
    write_array(tmp_path / "blocks/one-000000000-000000064.npy", np.zeros((68, 6), np.float32))
    assert not collect(tmp_path, 63).covered.any() and collect(tmp_path, 64).covered.all()
