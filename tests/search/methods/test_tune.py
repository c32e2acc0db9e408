import numpy as np
import pytest

from abhv_mc.search.methods.tune import Scores, pareto_front, tune

SHIFTS = np.random.default_rng(5).normal(0.0, 0.3, (200, 1, 4))


def noisy_quadratic(shifts, points):
    """Mean over common random shifts of the squared distance to (0.5, -0.3, 0.2, 0)."""
    target = np.array([0.5, -0.3, 0.2, 0.0])
    return ((points + shifts - target) ** 2).sum(axis=2)


def measure(points):
    objective = noisy_quadratic(SHIFTS, points).mean(axis=0)
    usage = np.abs(points).sum(axis=1)
    return Scores(objective, (points[:, :1] - 0.2), usage)


def test_finds_the_best_place_that_the_limit_allows():
    found = tune(measure, np.full(4, -0.5), 800, seed=3)
    centre = np.array([0.5, -0.3, 0.2, 0.0]) - SHIFTS.mean(axis=(0, 1))
    assert found.place[0] == pytest.approx(0.2, abs=0.01)
    np.testing.assert_allclose(found.place[1:], centre[1:], atol=0.05)
    assert found.scores.allowed[found.best] and found.scores.allowed[found.front].all()
    assert len(found.points) <= 800


def test_one_free_parameter():
    def line(points):
        return Scores((points[:, 0] - 0.7) ** 2, np.zeros((len(points), 0)), points[:, 0])

    assert tune(line, np.zeros(1), 300).place[0] == pytest.approx(0.7, abs=1e-3)


def test_broken_limits_come_after_all_that_keep_them_and_lost_flights_last():
    scores = Scores(
        np.array([5.0, 1.0, 0.5, np.inf, 4.0]),
        np.array([[0.0, -1.0], [0.1, 0.0], [0.3, 0.2], [-1.0, -1.0], [-2.0, 0.0]]),
        np.zeros(5),
    )
    assert scores.rank().tolist() == [1, 2, 3, 4, 0]
    assert scores.allowed.tolist() == [True, False, False, False, True]


def test_front_holds_what_nothing_beats():
    costs = np.array([[1.0, 5.0], [2.0, 3.0], [2.0, 4.0], [3.0, 3.0], [4.0, 1.0], [0.5, 9.0]])
    assert pareto_front(costs).tolist() == [5, 0, 1, 4]
    assert len(pareto_front(np.empty((0, 2)))) == 0
