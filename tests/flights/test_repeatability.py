"""Differences of repeated flights."""

import numpy as np

from abhv_mc.flights.repeatability import Repeatability, relative_difference, weakest


def test_differences_are_relative_to_the_larger_value_and_the_weakest_counts():
    a = np.array([2.0, -4.0, 0.0, np.nan, np.nan, np.inf, np.inf, 1.0])
    b = np.array([4.0, 1.0, 0.0, np.nan, 1.0, np.inf, 1.0, 0.0])
    assert relative_difference(a, b).tolist() == [0.5, 1.25, 0.0, 0.0, np.inf, 0.0, np.inf, 1.0]
    exact, rounding, declared, noise, shared = Repeatability
    assert weakest([None, rounding, exact]) == rounding and weakest([shared, noise]) == shared
    assert weakest([None]) is None
    assert [value.is_evidence for value in Repeatability] == [True] * 3 + [False] * 2
    assert weakest([declared, rounding]) == declared
