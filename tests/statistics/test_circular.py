"""Angles over flights and time do not depend on the seam."""

import numpy as np
import pytest

from abhv_mc.statistics.circular import align_flights


@pytest.mark.parametrize("start", range(0, 360, 45))
@pytest.mark.parametrize("low", [0.0, -180.0])
def test_aligned_flights_are_continuous_and_keep_their_bits(start, low):
    spread = np.random.default_rng(4).normal(0.0, 8.0, (50, 1))
    headings = start + 2.0 * np.arange(400.0) + spread
    aligned = align_flights(np.radians((headings - low) % 360.0 + low), 2.0 * np.pi)
    turns = (np.degrees(aligned) - headings) / 360.0
    assert turns == pytest.approx(np.full_like(turns, round(turns[0, 0])))
    assert align_flights(headings, 360.0).tobytes() == headings.tobytes()
