"""Values of envelopes on disk may be anybody's, as shards are: only whole blocks of this campaign are taken."""

import numpy as np
import pytest

from abhv_mc.folder.arrays import write_array
from abhv_mc.folder.envelope_states import Cells, Collector

CELLS = Cells(("altitude_m", "speed_mps"), (0, 1), 1, np.arange(3.0))


@pytest.mark.parametrize(
    ("values", "flights", "taken"),
    [
        (np.zeros((68, 6), np.float32), 64, True),
        (np.zeros((68, 6), np.float32), 63, False),  # beyond the campaign
        (np.zeros((68, 6)), 64, False),
        (np.zeros((68, 6), "<U3"), 64, False),
        (np.zeros((68, 5), np.float32), 64, False),
        (np.zeros(68, np.float32), 64, False),
    ],
)
def test_only_a_block_of_the_campaigns_type_and_shape_is_taken(tmp_path, values, flights, taken):
    write_array(tmp_path / "blocks/one-000000000-000000064.npy", values)
    covered = Collector(tmp_path, "one", np.ones(flights, bool), CELLS).covered
    assert covered.all() if taken else not covered.any()
