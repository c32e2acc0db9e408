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


@pytest.mark.parametrize("row", [0, 38])
def test_an_offset_is_no_larger_than_those_of_simulated_flights(row):
    """One of the simulated flights is shifted by more than the record, in noise of others."""
    for shift in (6.0, 0.0):
        draw = np.random.default_rng(3)
        simulated = curves(draw, np.ones(39), shift * (np.arange(39) == row))
        record = curves(draw, [1.0], [-2.0])[0]
        offset, is_significant = find_offset(simulated, record, 0.1, 0)
        assert is_significant == (shift == 0.0) and offset == pytest.approx(2.0, abs=0.5)


@pytest.mark.parametrize(("shift", "expected"), [(15.0, 4.0), (-15.0, -4.0)])
def test_an_offset_is_at_most_the_span(shift, expected):
    draw = np.random.default_rng(4)
    record = curves(draw, [1.0], [-shift])[0]
    assert find_offset(curves(draw, np.ones(39)), record, 0.02, 1) == (expected, True)


def test_a_channel_without_dispersion_is_not_used():
    """The second channel is a command that switches at the same time in all flights."""
    draw = np.random.default_rng(1)
    simulated = curves(draw, 1.0 + 0.05 * draw.standard_normal(39))
    record = curves(draw, [1.0], [-7.0])[0]
    expected = find_offset(simulated, record, 0.1, 1)
    for command in (1.0 * (TIME > 100.0), 0.0 * TIME):
        with_command = np.concatenate(
            [simulated, np.broadcast_to(command[:, None], (39, 200, 1))], axis=2
        )
        own = np.column_stack([record, np.roll(command, 7) + 0.1])
        assert find_offset(with_command, own, 0.1, 1) == expected
    assert find_offset(with_command[:, :, 2:], own[:, 2:], 0.1, 1) == (0.0, False)
    own[:, :2] = np.nan
    assert find_offset(with_command, own, 0.1, 1) == (0.0, False)
