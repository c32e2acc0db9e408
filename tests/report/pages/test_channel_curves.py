"""Curves of channels for the interactive views."""

import numpy as np
import pytest

from abhv_mc.report.pages.channel_curves import _thinned


@pytest.mark.parametrize(
    ("band", "expected"), [("min", [0, -7, -7]), ("max", [9, 9, 4]), ("q50", [0, 2, 4])]
)
def test_extremes_cover_the_samples_that_are_skipped(band, expected):
    curve = np.array([0.0, 9.0, 1.0, 2.0, -7.0, 3.0, 4.0])
    assert _thinned(curve, band, 3).tolist() == expected
