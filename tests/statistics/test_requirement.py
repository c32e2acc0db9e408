"""What counts as a failure: the limit itself, not-a-number, and an early end unless it counts as measured."""

import numpy as np
import pytest

from abhv_mc.statistics.requirement import measured_failures, requirement_failures

VALUES = np.array([49.9, 50.0, 50.1, np.nan])


@pytest.mark.parametrize(("below", "failed"), [(True, [False, True, True, True]), (False, [True, True, False, True])])
def test_a_value_at_the_limit_or_none_fails(below, failed):
    assert measured_failures(VALUES, 50.0, below).tolist() == failed


@pytest.mark.parametrize(("early_is_failure", "failed"), [(True, [True, False]), (False, [False, False])])
def test_an_early_end_fails_unless_it_counts_as_measured(early_is_failure, failed):
    early = np.array([True, False])
    assert requirement_failures(np.array([1.0, 1.0]), early, 50.0, True, early_is_failure).tolist() == failed


def test_the_measured_failures_stay():
    values, early = np.array([60.0, 60.0]), np.array([True, False])
    assert requirement_failures(values, early, 50.0, True, False).all()
