"""Angles made continuous, and quantiles over flights at each time."""

import numpy as np
import pytest
from scipy.special import ndtr

from abhv_mc.statistics.bands import QUANTILES, band_quantiles
from abhv_mc.statistics.circular import align_flights, unwrap


@pytest.mark.parametrize(
    ("starts", "seam", "aligned"),
    [
        ([330.0, 350.0, 20.0], 0.0, [-30.0, -10.0, 20.0]),
        ([340.0, 350.0], 0.0, [340.0, 350.0]),
        ([170.0, -170.0], -180.0, [170.0, 190.0]),
    ],
)
def test_angles_of_flights_and_times_are_continuous(starts, seam, aligned):
    truth = np.add.outer(aligned, np.linspace(0.0, 800.0, 60))
    values = (np.add.outer(starts, truth[0] - truth[0, 0]) - seam) % 360.0 + seam
    assert align_flights(values, 360.0) == pytest.approx(truth)
    values[0, 5] = np.nan
    own = unwrap(values[0], 360.0)
    assert np.delete(own - own[0], 5) == pytest.approx(np.delete(truth[0] - truth[0, 0], 5))


def test_a_mean_direction_needs_a_resultant_above_0_6():
    for half, exists in ((52.0, True), (54.0, False)):  # cos 52 deg = 0.616, cos 54 deg = 0.588
        flights = np.full((3, 2), [[half], [-half], [90.0]])
        assert np.isfinite(align_flights(flights, 360.0, 2)).all() == exists


def test_bands_are_quantiles_at_three_sigma_and_of_90_per_cent():
    assert pytest.approx((ndtr(-3.0), 0.05, 0.5, 0.95, ndtr(3.0)), abs=1e-6) == QUANTILES
    values = np.random.default_rng(4).normal(size=(5, 40))
    values[2, 7:], values[3, :9] = np.nan, np.nan
    expected = np.nanquantile(values, QUANTILES, axis=1)
    assert band_quantiles(values) == pytest.approx(expected, rel=1e-6)
    values[1] = np.nan
    assert np.isnan(band_quantiles(values)[:, 1]).all()
    none = band_quantiles(np.empty((3, 0)))
    assert none.shape == (5, 3) and np.isnan(none).all()
