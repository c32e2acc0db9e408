"""Related inputs, and the order of sizes."""

import numpy as np

from abhv_mc.statistics.ranks import discoveries, rank_largest, split_partners


def test_twins_are_one_driver_and_partners_name_the_driver_nearest_to_them():
    together = np.zeros((7, 7))
    for i, j, value in [
        (0, 1, 0.95),  # twins: the larger one remains
        (1, 4, 0.89),  # partners, but no twins
        (2, 1, 0.3),  # at the limit of partners
        (3, 1, 0.29),
        (5, 1, 0.4),
        (5, 4, 0.6),
        (6, 4, 0.9),  # at the limit of twins
    ]:
        together[i, j] = together[j, i] = value
    drivers = np.array([[1, 1, 0, 0, 1, 0, 1], [0] * 7, [1, 0, 0, 0, 0, 0, 0]], bool).T
    size = np.tile([[0.5], [0.9], [0.95], [0.2], [0.4], [0.1], [0.3]], 3)
    partners = split_partners(drivers, size, together, 0.3, 0.9)
    assert [np.flatnonzero(column).tolist() for column in drivers.T] == [[1, 4], [], [0]]
    assert partners.T.tolist() == [[1, -1, 1, -1, -1, 4, 4], [-1] * 7, [-1, 0] + [-1] * 5]


def test_sizes_equal_to_nine_decimals_keep_their_order_and_nan_is_zero():
    sizes = np.array([np.nan, 0.3, 0.5, 0.3 + 4e-10, 0.3 - 2e-9, 1e-8])
    assert rank_largest(sizes) == [2, 1, 3, 4, 5, 0]


def test_untested_cases_are_no_discoveries():
    p_values = np.array([0.01, np.nan, 0.02, 0.045, 0.5])  # 0.045 * 4 / 3 = 0.06
    assert discoveries(p_values, 0.06).tolist() == [True, False, True, True, False]
    assert not discoveries(p_values, 0.059)[3]
