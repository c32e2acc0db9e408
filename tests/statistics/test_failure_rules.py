"""Where exactly failures begin, next to values that are infinite: the times of failures that never come."""

import numpy as np
import pytest

from abhv_mc.statistics.failure_rules import Condition, Rule, sharpen


@pytest.mark.parametrize(("above", "threshold"), [(False, 5.0), (True, 30.0)])
def test_a_threshold_beside_infinite_values_is_finite(above, threshold):
    early = np.linspace(1.0, 5.0, 40) + (25.0 if above else 0.0)  # of the failure, which most flights never have
    values = np.concatenate([early, np.full(60, np.inf)])
    failed = np.isinf(values) if above else np.isfinite(values)
    rule = Rule((Condition(0, above, early[-3]),), 20, int(failed.sum()), 0, int((~failed).sum()), 0.0, 0.0)
    (condition,) = sharpen(rule, failed, lambda _: values).conditions
    assert condition.threshold == threshold
