"""What counts as a failure and by how much: the limit itself, not-a-number, two limits, an early end."""

import numpy as np
import pytest

from abhv_mc.bounds import Bounds

VALUES = np.array([2.8, 3.0, 3.1, 49.9, 50.0, 50.1, np.nan])


@pytest.mark.parametrize(
    ("limits", "kept", "most"),
    [
        (Bounds(high=50.0), [0, 1, 2, 3], 0.1),
        (Bounds(low=3.0), [2, 3, 4, 5], 0.2),
        (Bounds(3.0, 50.0), [2, 3], 0.2),
    ],
    ids=str,
)
def test_a_value_at_a_limit_or_none_fails(limits, kept, most):
    failed = limits.failures(VALUES)
    assert np.flatnonzero(~failed).tolist() == kept
    beyond = limits.worse(VALUES) - limits.limit
    np.testing.assert_array_equal(failed, ~(beyond < 0.0))
    assert np.nanmax(beyond) == pytest.approx(most)


def test_of_two_limits_a_distance_is_a_share_of_half_their_distance():
    assert Bounds(3.0, 50.0).size == 23.5 and Bounds(low=-3.0).size == 3.0
    assert Bounds(3.0, 50.0).worse(np.array([26.5])) == -23.5


def test_an_early_end_fails_and_measured_failures_stay():
    early = np.array([True, False])
    assert Bounds(high=50.0).failures(np.array([1.0, 60.0]), early).tolist() == [True, True]
    assert Bounds(high=50.0).failures(np.array([1.0, 1.0]), early & False).tolist() == [False, False]
