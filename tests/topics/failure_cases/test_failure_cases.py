"""Survival after a failure, and the sentences about it."""

import numpy as np
import pytest

from abhv_mc.topics.failure_cases.figures import still_flying


def test_still_flying_is_kaplan_and_meiers_estimate():
    after = np.array([1.0, 2.0, 2.0, 3.0, 5.0])  # the third's and the last's missions were over
    lost = np.array([True, True, False, True, False])
    share = still_flying(after, lost, np.array([0.5, 1.0, 2.5, 4.0, 6.0]))
    assert share[:4] == pytest.approx([1.0, 0.8, 0.8 * 3 / 4, 0.8 * 3 / 4 * 1 / 2])
    assert np.isnan(share[4])
    everyone = still_flying(after[:2], lost[:2], np.array([0.0, 10.0]))
    assert everyone.tolist() == [1.0, 0.0]
