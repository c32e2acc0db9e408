"""Tests of the offset in time between a record and simulated flights."""

import numpy as np
import pytest

from abhv_mc.statistics.placement import find_offset

TIME = np.arange(200.0)


def curves(draw, drag, shift=0.0):
    """Return a decay and an oscillation [flight, time, channel] with noise."""
    clock = TIME + np.reshape(shift, (-1, 1))
    decay = np.exp(-0.005 * np.reshape(drag, (-1, 1)) * clock)
    histories = np.stack([decay, np.broadcast_to(np.sin(0.1 * clock), decay.shape)], axis=2)
    return histories + 0.01 * draw.standard_normal(histories.shape)


@pytest.mark.parametrize(
    ("drag", "shift"), [(1.0, 0.0), (1.0, 7.3), (1.0, -12.6), (1.4, 0.0), (1.4, 7.3)]
)
def test_an_offset_is_found_and_a_dispersion_is_not_taken_for_one(drag, shift):
    draw = np.random.default_rng(1)
    simulated = curves(draw, 1.0 + 0.05 * draw.standard_normal(39))
    record = curves(draw, [drag], [-shift])[0]
    record[40:60, 0] = np.nan
    offset, is_significant = find_offset(simulated, record, 0.1, 1)
    assert is_significant == (shift != 0.0)
    assert not is_significant or offset == pytest.approx(shift, abs=0.5)
