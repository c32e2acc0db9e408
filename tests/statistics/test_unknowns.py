"""Verdicts over unknowns: points, search, rule, and risk by a reduced simulation."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from abhv_mc.statistics.unknowns import (
    Search,
    Trial,
    choose_points,
    corners,
    judge_points,
    most_points,
    search_flights,
    search_size,
    search_worst,
    showing_factor,
)
from abhv_mc.statistics.verdicts import judge
from benchmarks import unknowns as benchmark

AT = 0.9973, 0.10


@pytest.mark.parametrize("unknowns", [1, 4, 7, 8, 11, 64])
def test_corners_are_full_or_of_resolution_four(unknowns):
    points = corners(unknowns)
    assert points.shape == (2 ** min(unknowns, 7), unknowns)
    assert np.array_equal(
        points.T @ points, len(points) * np.eye(unknowns)
    )  # balanced, and no effect hides another
    rows = set(map(tuple, points))
    assert len(rows) == len(points) and all(tuple(-row) in rows for row in points)
    for i, j in combinations(range(unknowns), 2):  # nor does a product of two
        assert not np.any((points[:, i] * points[:, j]) @ points)


def quadratic(*peaks):
    """Simulate trials with a severity for each peak and no failure.

    The worst flight has the severity that the quantile predicts.
    """

    def evaluate(points):
        severity = -np.column_stack([np.sum((points - peak) ** 2, axis=1) for peak in peaks])
        return Trial(severity, np.zeros(severity.shape, int), severity)

    return evaluate


def test_points_are_corners_center_and_the_worst_of_each_requirement():
    inner, corner = np.array([0.4, -0.3, 0.1]), np.ones(3)
    search = search_worst(quadratic(inner, corner), 3, np.random.default_rng(1))
    tried = search.points
    assert len(np.unique(tried, axis=0)) == len(tried) <= 8 + 1 + 32 + 2 * 64
    assert np.array_equal(search.trial.severity, quadratic(inner, corner)(tried).severity)
    assert np.abs(tried).max() == 1.0
    points, shared, most = choose_points(3, [search])
    assert shared == len(points) and [entry.failures for entry in most] == [0, 0]
    assert [entry.point for entry in most] == [9, 7]
    assert len(points) == 10 and np.array_equal(points[:8], corners(3)) and not points[8].any()
    assert points[9] == pytest.approx(inner, abs=0.1)
    assert np.array_equal(choose_points(3, [search] * 2).points, points)


def test_beyond_four_unknowns_the_worst_corner_and_its_opposite_stand_for_all():
    worst = np.array([1.0, 1.0, -1.0, 1.0, -1.0])
    search = search_worst(quadratic(0.5 * worst), 5, np.random.default_rng(2))
    points = choose_points(5, [search]).points
    assert np.array_equal(points[:3], [np.zeros(5), worst, -worst])
    assert len(points) == 4 and points[3] == pytest.approx(0.5 * worst, abs=0.35)


def made_search(failures, largest=None):
    """A search of five unknowns: corner 31 ranks worst for both requirements, other points fail."""
    points = np.vstack([corners(5), np.zeros((1, 5)), np.full((1, 5), 0.5)])
    severity = np.zeros((len(points), 2))
    severity[31] = 1.0
    table = np.zeros(severity.shape, int)
    extremes = np.full(severity.shape, -2.0)
    for (point, requirement), number in failures.items():
        table[point, requirement] = number
    for (point, requirement), value in (largest or {}).items():
        extremes[point, requirement] = value
    return Search(points, Trial(severity, table, extremes))


def test_the_point_with_the_most_failures_is_judged_for_its_requirement():
    points, shared, most = choose_points(
        5, [made_search({(7, 0): 4, (33, 0): 2, (31, 1): 3, (9, 1): 3})]
    )
    assert shared == 3 and np.array_equal(points[:3], [np.zeros(5), np.ones(5), -np.ones(5)])
    assert np.array_equal(points[3:], corners(5)[[7]])
    # The second requirement failed as often at a judged point.
    assert [tuple(entry) for entry in most] == [(0, 0, 3, 4), (0, 1, 1, 3)]


def test_a_second_controller_adds_its_own_point_only_if_it_fails_more_often():
    first, same = made_search({(7, 0): 4}), made_search({(7, 0): 2, (8, 0): 2})
    assert len(choose_points(5, [first, same]).points) == 4
    other = made_search({(7, 0): 2, (8, 0): 3})
    points, shared, most = choose_points(5, [first, other])
    assert (len(points), shared) == (5, 3) and np.array_equal(points[4], corners(5)[8])
    assert [entry.point for entry in most if entry.requirement == 0] == [3, 4]


def test_without_failures_the_point_of_the_flight_nearest_to_the_limit_is_judged():
    points, shared, most = choose_points(5, [made_search({}, {(12, 0): -0.5, (31, 0): -1.0})])
    assert (len(points), shared) == (4, 3) and np.array_equal(points[3], corners(5)[12])
    assert [tuple(entry)[2:] for entry in most] == [(3, 0), (1, 0)]
    lost = made_search({(12, 0): 1}, {(12, 0): np.inf})
    assert np.array_equal(choose_points(5, [lost]).points[3], corners(5)[12])


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
    verdicts = [
        judge(k, flights, *AT, uncomputed=uncomputed if k == max(failures) else 0) for k in failures
    ]
    joint, worst = judge_points(verdicts)
    assert joint.status == status
    assert worst == (1 if max(failures) else 0) and joint.failures == max(failures) + uncomputed
    assert joint.E_fail == pytest.approx(sum(verdict.E_fail for verdict in verdicts) / 3)


@pytest.mark.parametrize(("evidence", "status"), [(9.99, "NOT SHOWN"), (10.01, "FAIL")])
def test_the_mean_evidence_of_a_miss_decides_with_the_producers_risk(evidence, status):
    verdict = judge(5, 1000, *AT)
    assert verdict.producer_risk == 0.1
    verdicts = [replace(verdict, E_fail=value) for value in (2.0 * evidence, 0.0)]
    assert judge_points(verdicts)[0].status == status


@pytest.mark.parametrize(
    ("system", "passes", "fails"),
    [
        (dict(unknowns=3, rate=0.2, shape="ramp", rise=0.8), (0.7, 1.0), (0.0, 0.0)),
        # The corners alone pass in half of them.
        (dict(unknowns=3, rate=3.0, shape="bump", width=0.4, rise=1.2), (0.0, 0.0), (0.7, 1.0)),
        # At the points of the largest quantile alone 0.87, 0.33 and 0.92 of them pass.
        (dict(unknowns=5, rate=5.5, shape="spread", mixed=0.0), (0.0, 0.04), (0.4, 1.0)),
        (dict(unknowns=5, rate=3.0, shape="wide", width=0.5, sides=2), (0.0, 0.0), (0.1, 1.0)),
    ],
)
def test_risks_by_simulation(system, passes, fails):
    shares, _ = benchmark.simulate(benchmark.System("", **system), repetitions=30)
    assert passes[0] <= shares["rule PASS"] <= passes[1]
    assert fails[0] <= shares["rule FAIL"] <= fails[1]


def test_a_trial_of_few_flights_searches_with_few():
    assert [search_size(runs) for runs in (8, 32, 64, 256, 2200)] == [32, 32, 64, 256, 256]
    assert search_flights(3, 2, 64) * 4 == search_flights(3, 2, 2200)
    assert search_flights(5, 2, 64) == 64 * (32 + 1 + 32 + 2 * 64)
    assert showing_factor(0.99, 64) == 4 * showing_factor(0.99) == pytest.approx(2 / 0.64)
    assert [most_points(number, 3) for number in (1, 4, 5)] == [2 + 1 + 6, 16 + 1 + 6, 1 + 12]
