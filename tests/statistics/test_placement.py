"""Tests of the comparison of test flights with simulated ones.

Ranks are exact, and a band contains whole histories with its stated probability.
"""

import numpy as np
import pytest
from scipy import stats

from abhv_mc.statistics.placement import (
    judge_set,
    rank_p_values,
    simultaneous_band,
)


def test_rank_p_values_are_those_of_ranks_in_the_pool():
    pool = np.array([[3.0], [1.0], [2.0], [2.0], [9.0]])
    expected = 2.0 / 5.0 * np.array([2.0, 1.0, 3.0, 3.0, 1.0])  # flights as far out on its side
    assert rank_p_values(pool)[:, 0] == pytest.approx(np.minimum(expected, 1.0))


def test_p_values_are_exact_whatever_the_grouping():
    """Use each of the simulated sets as the test set in turn.

    At most a share p has a p-value of p or less, for flights, corrected for their number, and sets.
    """
    draw = np.random.default_rng(3)
    vehicles = 0.9 * draw.standard_normal((100, 2, 3))[:, [0, 0, 1, 1]]
    pool = np.dstack([vehicles + draw.standard_normal((100, 4, 3)), draw.integers(0, 4, (100, 4))])
    pool[draw.uniform(size=pool.shape) < 0.05] = np.nan
    results = [judge_set(np.roll(pool, k, axis=0)) for k in range(len(pool))]
    for p_value in (0.02, 0.05, 0.1, 0.5):
        for p_values in ([r.together for r in results], [r.flights.min() for r in results]):
            assert 0.4 * p_value <= np.mean(np.array(p_values) <= p_value + 1e-9) <= p_value + 1e-9


@pytest.mark.parametrize("flights", [2, 3])
def test_p_values_are_those_of_the_statistics_of_the_definition(flights):
    pool = np.random.default_rng(9).standard_normal((30, flights, 2))
    pool += 5.0 * np.arange(flights)[:, None]  # Each flight of a set has its own conditions.
    ranks = stats.rankdata(stats.zscore(pool).reshape(-1, 2), axis=0)
    p_values = 2.0 * np.minimum(ranks, len(ranks) + 1 - ranks) / len(ranks)
    normal = stats.norm.ppf((ranks - 0.5) / len(ranks))

    def distances(values):
        values = (values - values.mean(axis=0)) / values.std(axis=0)
        inverse = np.linalg.inv(values.T @ values / len(values) + 1e-3 * np.eye(2))
        return np.array([row @ inverse @ row for row in values])

    def shares(values):
        return np.array([np.mean(values >= value - 1e-9) for value in values])

    least = np.minimum(shares(-p_values.min(axis=1)), shares(distances(normal)))
    first, normal = least.reshape(30, -1).min(axis=1), normal.reshape(pool.shape)
    # Means of two flights are not subtracted from their covariance.
    covariances = [np.cov(own.T, bias=True) if flights > 2 else own.T @ own / 2 for own in normal]
    inverse = np.linalg.inv(np.mean(covariances, axis=0) + 1e-3 * np.eye(2))
    losses = [
        np.trace(own @ inverse) - np.log(np.linalg.det(flights * own @ inverse + np.eye(2)))
        for own in covariances
    ]
    means, squares = normal.mean(axis=1), (normal**2).mean(axis=1)
    largest = [np.abs(stats.zscore(values)).max(axis=1) for values in (means, squares)]
    together = np.array([*map(shares, (*largest, distances(means), np.array(losses), -first))])
    joint = together.min(axis=0) + together.sum(axis=0) / 30_000
    for k in range(30):
        result = judge_set(np.roll(pool, -k - 1, axis=0))
        own = slice(k * flights, (k + 1) * flights)
        assert result.columns == pytest.approx(p_values[own])
        assert result.flights == pytest.approx([np.mean(first <= value) for value in least[own]])
        assert result.together == pytest.approx(np.mean(joint <= joint[k] + 1e-12))


def test_deviations_of_histories_and_missing_values():
    draw = np.random.default_rng(2)
    pool, scores = draw.standard_normal((100, 3, 2)), draw.uniform(size=(100, 3))
    pool[:, 1, 0] = np.nan
    scores[-1, 2] = 2.0
    result = judge_set(pool, scores)
    assert result.flights[2] == pytest.approx(result.flights.min()) and result.flights[2] <= 0.05
    assert np.isfinite(result.columns).all()


def test_scores_are_deviations_from_all_other_flights():
    draw = np.random.default_rng(4)
    histories = draw.standard_normal((15, 4, 2)) * [1.0, 5.0] + [0.0, 100.0]
    histories[3, 2:] = np.nan  # ended early
    band = simultaneous_band(histories, 0.8)
    floor = 0.05 * np.nanstd(histories, axis=0, ddof=1).max(axis=0)
    for k in range(15):
        others = np.nanquantile(np.delete(histories, k, axis=0), [0.025, 0.5, 0.975], axis=0)
        below, above = (np.maximum(width, floor) for width in np.diff(others, axis=0))
        deviation = histories[k] - others[1]
        score = np.nanmax(np.where(deviation > 0.0, deviation / above, -deviation / below))
        assert band.scores[k] == pytest.approx(score, rel=1e-9)
    ends = np.nanquantile(histories, [0.025, 0.5, 0.975], axis=0)
    widths = band.factor * np.maximum(np.diff(ends, axis=0), floor)
    assert band.edges[0] == pytest.approx(ends[1] - widths[0])
    assert band.edges[1] == pytest.approx(ends[1] + widths[1])
    assert band.factor == np.sort(band.scores)[12]  # the 13th of 15: 0.8 of 16, rounded up
    assert band.deviations(np.full((4, 2), np.nan)).max() == 0.0
    assert simultaneous_band(histories, 0.99).factor == np.inf


def test_a_channel_without_spread_is_left_by_any_other_value():
    histories = np.ones((50, 3, 1)) / 3.0
    band = simultaneous_band(histories)
    assert band.deviations(histories[0]).max() <= band.factor
    assert band.deviations(histories[0] + 1e-3).max() > band.factor


def test_the_band_holds_19_in_20_honest_histories():
    draw = np.random.default_rng(5)

    def walks(number):
        return np.cumsum(draw.standard_normal((number, 20, 2)), axis=1)

    outside = []
    for _ in range(40):
        band = simultaneous_band(walks(99))
        outside += [band.deviations(test).max() > band.factor for test in walks(50)]
    assert np.mean(outside) == pytest.approx(0.05, abs=0.015)


def test_single_precision_does_not_widen_the_band():
    draws = np.random.default_rng(1).normal(0.0, 2e-4, (100, 1, 1))
    histories = np.linspace(0.0, 1.0, 30)[:, np.newaxis] * draws
    stored = np.float32(180.0 + histories).astype(float)
    assert simultaneous_band(stored).factor < 1.2 * simultaneous_band(histories).factor
