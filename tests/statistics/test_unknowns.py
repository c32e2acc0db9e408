"""Verdicts over unknowns: the points, the search, the rule, and its risk by a reduced simulation."""

from itertools import combinations

import numpy as np
import pytest

from abhv_mc.statistics.unknowns import corners, judge_points, points_flown, search_worst
from abhv_mc.statistics.verdicts import judge
from benchmarks import unknowns as benchmark

AT = 0.9973, 0.10


@pytest.mark.parametrize("unknowns", [1, 4, 7, 8, 11, 64])
def test_corners_are_full_or_of_resolution_four(unknowns):
    found = corners(unknowns)
    assert found.shape == (2 ** min(unknowns, 7), unknowns)
    assert np.array_equal(
        found.T @ found, len(found) * np.eye(unknowns)
    )  # balanced, and no effect hides another
    rows = set(map(tuple, found))
    assert len(rows) == len(found) and all(tuple(-row) in rows for row in found)
    for i, j in combinations(range(unknowns), 2):  # nor does a product of two
        assert not np.any((found[:, i] * found[:, j]) @ found)


def quadratic(peak, scale=1.0):
    return lambda points: -scale * np.sum((points - peak) ** 2, axis=1)


def test_points_are_corners_center_and_the_worst_of_each_requirement():
    inner, corner = np.array([0.4, -0.3, 0.1]), np.ones(3)
    both = lambda points: np.column_stack([quadratic(inner)(points), quadratic(corner)(points)])  # noqa: E731
    tried, found = search_worst(both, 3, np.random.default_rng(1))
    assert tried.shape == (8 + 1 + 32 + 2 * 64, 3) and found.shape == (len(tried), 2)
    assert np.abs(tried).max() == 1.0
    points = points_flown(tried.shape[1], [(tried, found)])
    assert len(points) == 10 and np.array_equal(points[:8], corners(3)) and not points[8].any()
    assert points[9] == pytest.approx(inner, abs=0.1)
    assert np.array_equal(points_flown(3, [(tried, found)] * 2), points)


def test_beyond_four_unknowns_the_worst_corner_and_its_opposite_stand_for_all():
    worst = np.array([1.0, 1.0, -1.0, 1.0, -1.0])
    tried, found = search_worst(
        lambda points: quadratic(0.5 * worst)(points)[:, None], 5, np.random.default_rng(2)
    )
    points = points_flown(tried.shape[1], [(tried, found)])
    assert np.array_equal(points[:3], [np.zeros(5), worst, -worst])
    assert len(points) == 4 and points[3] == pytest.approx(0.5 * worst, abs=0.35)


@pytest.mark.parametrize(
    ("failures", "uncomputed", "status"),
    [
        ((0, 0, 0), 0, "PASS"),
        ((0, 1, 0), 0, "NOT SHOWN"),
        ((0, 0, 0), 1, "NOT SHOWN"),
        ((0, 9, 0), 0, "NOT SHOWN"),  # alone E_fail is 19 and a FAIL, its third is none
        ((0, 10, 0), 0, "FAIL"),
    ],
)
def test_verdict_over_points(failures, uncomputed, status):
    flights = 1000
    each = [
        judge(k, flights, *AT, uncomputed=uncomputed if k == max(failures) else 0) for k in failures
    ]
    found, worst = judge_points(each)
    assert found.status == status
    assert worst == (1 if max(failures) else 0) and found.failures == max(failures) + uncomputed
    assert found.E_fail == pytest.approx(sum(one.E_fail for one in each) / 3)


@pytest.mark.parametrize(
    ("system", "passes", "fails"),
    [
        (("", 3, 3.0, "ramp", 0.0, 0.8), (0.0, 0.0), (0.9, 1.0)),
        (("", 3, 0.2, "ramp", 0.0, 0.8), (0.7, 1.0), (0.0, 0.0)),
        (
            ("", 3, 3.0, "bump", 0.4, 1.2),
            (0.0, 0.0),
            (0.7, 1.0),
        ),  # the corners alone pass in half of them
        (("", 5, 3.0, "interaction", 0.0, 0.8), (0.0, 0.0), (0.8, 1.0)),
        (("", 3, 0.2, "corners"), (0.1, 0.6), (0.0, 0.0)),
    ],
)
def test_risks_by_simulation(system, passes, fails):
    shares, _ = benchmark.simulate(benchmark.System(*system), repetitions=30)
    assert passes[0] <= shares[3] <= passes[1]
    assert fails[0] <= shares[4] <= fails[1]
