"""Angles over flights and time do not depend on the seam."""

import numpy as np
import pytest

from abhv_mc.statistics.circular import align_flights, follow, unwrap

TIMES = np.arange(400.0)


def turning(flights=50):
    """Return headings [flight, time] in deg that make two turns; two flights end early."""
    draw = np.random.default_rng(4)
    headings = 2.0 * TIMES + draw.normal(0.0, 8.0, (flights, 1)) + np.sin(TIMES)
    headings[:2, 300:] = np.nan
    return headings


@pytest.mark.parametrize("start", range(0, 360, 45))
@pytest.mark.parametrize("low", [0.0, -180.0])
def test_aligned_flights_do_not_depend_on_heading_and_convention(start, low):
    wrapped = (turning() + start - low) % 360.0 + low
    aligned = align_flights(wrapped, 360.0)
    offset = np.round((aligned - turning() - start) / 360.0)
    assert np.nanmin(offset) == np.nanmax(offset)
    assert aligned == pytest.approx(turning() + start + 360.0 * offset, nan_ok=True)
    radians = align_flights(np.radians(wrapped), 2.0 * np.pi)
    assert np.degrees(radians) == pytest.approx(aligned, nan_ok=True)


@pytest.mark.parametrize("start", [0.0, 90.0, 300.0, -170.0, 720.0])
def test_flights_that_do_not_cross_the_seam_keep_their_bits(start):
    headings = (start + 20.0 + turning()[:, :20] / 8.0).astype(np.float32)
    headings[0, 0] = -0.0 if start == 0.0 else headings[0, 0]
    assert align_flights(headings, 360.0).astype(np.float32).tobytes() == headings.tobytes()


def test_flights_that_spread_over_the_circle_have_no_mean():
    headings = np.tile(np.linspace(0.0, 315.0, 8)[:, None], 3)
    headings[:, 1] /= 9.0
    assert np.isnan(align_flights(headings, 360.0)).all(axis=0).tolist() == [True, False, True]
    assert np.isnan(align_flights(np.full((3, 2), np.nan), 360.0)).all()


def test_curves_are_continuous_and_follow_another_curve():
    wrapped = np.array([350.0, np.nan, 10.0, 20.0, np.nan])
    expected = [350.0, np.nan, 370.0, 380.0, np.nan]
    assert unwrap(wrapped, 360.0) == pytest.approx(expected, nan_ok=True)
    leader = TIMES[1:4], np.array([-5.0, np.nan, 15.0])
    followed = follow(TIMES[:5], wrapped, 360.0, leader)
    assert followed == pytest.approx(np.array(expected) - 360.0, nan_ok=True)
