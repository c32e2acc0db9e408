"""Tests of the check that the rows of a table are independent draws."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from abhv_mc.execution.table_import import make_column
from abhv_mc.statistics.table_checks import (
    check_table,
    distance_p_values,
    half_steps,
    spread_p_values,
)

NORMAL, NONE = stats.norm(20.0, 0.5), np.empty(0)


def column(values, law=NORMAL, atoms=NONE, shares=NONE):
    return replace(make_column(law, values, half_steps(values)), atoms=atoms, shares=shares)


def rounded(values, digits):
    return np.array([float(f"{value:.{digits - 1}e}") for value in values.flat]).reshape(
        values.shape
    )


def check(*columns, correlation=None, **options):
    matrix = np.eye(len(columns)) if correlation is None else np.array(correlation)
    return check_table(columns, matrix, **options)


@pytest.mark.parametrize(
    ("values", "halves"),
    [
        ([12.3, 45.67, 10.0], [0.005, 0.005, 0.005]),  # two decimals
        ([12.3, 9.87, 0.123, 11.0], [0.05, 0.005, 0.0005, 0.05]),  # three significant digits
        ([0.25, -0.5, 0.0], [0.005, 0.005, 0.005]),
        ([0.0, 0.0], [0.0, 0.0]),
        ([3e-7, 2.5e-7], [5e-9, 5e-9]),
    ],
)
def test_steps_are_those_of_decimals_and_of_digits(values, halves):
    assert half_steps(np.array(values)) == pytest.approx(halves)


def test_all_digits_leave_no_step():
    values = np.random.default_rng(1).normal(20.0, 0.5, 1000)
    assert half_steps(values).max() < 1e-10
    assert half_steps(values * 0.3048 / 0.3048) == pytest.approx(half_steps(values), abs=1e-10)


def test_p_values_of_exact_values_are_those_of_scipy():
    uniform = np.random.default_rng(2).random(80)
    far, close = distance_p_values(uniform, uniform)
    exact = stats.kstest(uniform, "uniform", method="exact").pvalue
    assert far == pytest.approx(exact) and close == pytest.approx(1.0 - exact)
    score = np.sum(stats.norm.ppf(uniform) ** 2)
    assert spread_p_values(uniform, uniform) == pytest.approx(
        (stats.chi2.cdf(score, 80), stats.chi2.sf(score, 80))
    )


@pytest.mark.parametrize("digits", [2, 3])
def test_rounding_makes_no_p_value_smaller(digits):
    for seed in range(20):
        values = NORMAL.rvs(60, random_state=seed)
        exact, table = NORMAL.cdf(values), column(rounded(values, digits))
        for p_values in (distance_p_values, spread_p_values):
            for wide, point in zip(
                p_values(table.low, table.high), p_values(exact, exact), strict=True
            ):
                assert wide >= point - 1e-12


@pytest.mark.parametrize("digits", [None, 3])  # 3: a fifth of sigma
@pytest.mark.parametrize("factor", [1 / 3, 3])
def test_a_spread_three_times_too_narrow_or_wide_is_found(factor, digits):
    for seed in range(10):
        values = 20.0 + factor * (NORMAL.rvs(60, random_state=seed) - 20.0)
        assert check(column(values if digits is None else rounded(values, digits))).too_far == (0,)


def test_a_latin_hypercube_is_too_close_from_about_twenty_rows_on():
    random = np.random.default_rng(3)
    for rows in (20, 60):
        values = NORMAL.ppf((random.permutation(rows) + random.random(rows)) / rows)
        findings = check(column(values))
        assert findings.too_close == (0,) and not findings.too_far
    assert not check(column(NORMAL.rvs(1000, random_state=4))).too_close


def test_a_constant_column_is_too_far_or_shows_no_dispersion():
    assert check(column(np.full(60, 20.1234))).too_far == (0,)
    findings = check(column(np.full(60, 20.0)))  # as rounded to tens
    assert findings.constant == (0,) and not findings.too_far


@pytest.mark.parametrize("digits", [None, 5, "f4"])
@pytest.mark.parametrize(
    "law", [NORMAL, stats.uniform(50.0, 2.0), stats.triang(0.0, 3.0, 1.0), stats.expon(2.0)]
)
def test_extremes_are_missing_only_where_rows_were_removed(law, digits):
    for seed in range(20):
        values = law.rvs(1100, random_state=seed)
        values = rounded(values, digits) if digits == 5 else values.astype(digits or "f8")
        values = values.astype(float)
        findings = check(column(values, law))
        assert not findings.missing and findings.equal is None
        assert check(column(values[values < law.ppf(0.97725)][:1000], law)).missing == ((0, 1),)
        assert check(column(values[values > law.ppf(0.02275)][:1000], law)).missing == ((0, 0),)


@pytest.mark.parametrize(("factor", "is_found"), [(1.01, True), (0.99, False)])
def test_columns_levels_and_pairs_share_the_risk(factor, is_found):
    """Four tests of each of three columns, two of each of two atoms, and one of each of six pairs.

    A risk just above 22 times a p-value shows the contradiction.
    """
    random, n = np.random.default_rng(11), 80
    x, y, wide = random.standard_normal((3, n))
    y = 0.6 * x + 0.8 * y
    wide = 1.6 * wide
    ones = np.repeat([0.0, 1.0], [62, 18])
    atoms, shares = np.array([0.0, 1.0]), np.array([0.9, 0.1])
    law = stats.rv_discrete(values=(atoms.astype(int), shares))
    columns = [*(column(v, stats.norm()) for v in (x, y, wide)), column(ones, law, atoms, shares)]
    stated, level = 0.05, stats.binom.sf(17, n, 0.1)
    correlation = np.eye(4)
    correlation[0, 1] = correlation[1, 0] = stated
    mean = 6.0 / np.pi * (np.arcsin(stated) + (n - 2) * np.arcsin(stated / 2.0)) / (n + 1)
    sigma = ((1.0 + 0.5 * (6.0 / np.pi * np.arcsin(stated / 2.0)) ** 2) / (n - 3)) ** 0.5
    rank = stats.spearmanr(x, y).statistic
    pair = 2.0 * stats.norm.sf(abs(np.arctanh(rank) - np.arctanh(mean)) / sigma)
    spread = stats.chi2.sf(np.sum(wide**2), n)
    assert max(pair, level) < 0.05 / 22 and spread < stats.kstest(wide, "norm").pvalue

    def find(p_value):
        return check(*columns, correlation=correlation, risk=22.0 * factor * p_value)

    assert (2 in find(spread).too_far) == is_found
    assert [(found.column, found.count) for found in find(level).levels] == (
        [(3, 62), (3, 18)] if is_found else []
    )
    pairs = [found for found in find(pair).correlations if found.columns == (0, 1)]
    assert len(pairs) == is_found
    if is_found:
        assert pairs[0].found == pytest.approx(rank)
        assert pairs[0].stated == pytest.approx(6.0 / np.pi * np.arcsin(stated / 2.0))
    # Missing extremes have a risk of their own, shared by both sides of three columns.
    tail = 1.0 - (1e-6 / factor / 6.0) ** (1.0 / n)
    columns[1] = replace(columns[1], tails=(0.0, tail))
    assert check(*columns, risk=1e-6).missing == (((1, 1),) if is_found else ())


def test_levels_are_counted_exactly():
    atoms, shares = np.array([0.0, 1.0]), np.array([0.999, 0.001])
    law = stats.rv_discrete(values=(atoms.astype(int), shares))

    def levels(ones, rows=1000):
        return check(column(np.repeat([0.0, 1.0], [rows - ones, ones]), law, atoms, shares)).levels

    assert not levels(0) and not levels(5)
    (level,) = levels(12)[1:]
    assert (level.value, level.count, level.probability) == (1.0, 12, 0.001)
    assert levels(0, rows=20_000)


def test_rank_correlations_are_compared_with_the_stated_ones():
    random = np.random.default_rng(5)
    x, y = random.multivariate_normal([0.0, 0.0], [[1.0, 0.9], [0.9, 1.0]], 300).T
    stated = [[1.0, 0.9], [0.9, 1.0]]
    law = stats.norm()
    for digits in (None, 2):
        pair = [column(v if digits is None else rounded(v, digits), law) for v in (x, y)]
        assert not check(*pair, correlation=stated).correlations
        (contradiction,) = check(*pair).correlations
        assert contradiction.columns == (0, 1) and contradiction.stated == 0.0
        assert contradiction.found == pytest.approx(stats.spearmanr(x, y).statistic, abs=0.02)
    assert check(column(x, law), column(-y, law), correlation=stated).correlations


def test_rows_that_are_equal_beyond_rounding_are_found():
    random = np.random.default_rng(6)
    values = rounded(NORMAL.rvs((60, 2), random_state=random), 4)
    findings = check(*(column(np.tile(v, 4)) for v in values.T))
    assert findings.equal is not None and findings.equal.pairs == 60 * 6
    first, second = findings.equal.example
    assert first % 60 == second % 60 and first < second
    coarse = rounded(NORMAL.rvs(1000, random_state=random), 3)  # hundreds of equal pairs
    assert check(column(coarse)).equal is None
    pair = rounded(NORMAL.rvs((300, 2), random_state=random), 4).T
    assert check(*map(column, pair)).equal is None
    assert check(*(column(np.tile(v, 3)) for v in pair)).equal is not None


def test_rows_at_the_atoms_alone_are_no_copies():
    random = np.random.default_rng(7)
    atoms, shares = np.array([0.0]), np.array([0.95])

    class Switch:
        @staticmethod
        def cdf(x):
            return 0.05 * stats.norm.cdf(x) + 0.95 * (x >= 0.0)

    values = np.where(random.random((300, 2)) < 0.05, random.normal(size=(300, 2)), 0.0)
    columns = [column(v, Switch, atoms, shares) for v in values.T]
    assert check(*columns) == check(*columns, risk=1e-3)
    assert check(*columns).equal is None


def test_honest_tables_pass_at_a_risk_that_would_show():
    laws = [stats.uniform(-2.0, 4.0), NORMAL, stats.lognorm(0.5), stats.beta(2.0, 5.0)]
    wrong = 0
    for seed in range(60):
        random = np.random.default_rng([8, seed])
        values = [law.rvs(60 + 5 * seed, random_state=random) for law in laws]
        digits = (None, 4, 3, 2)[seed % 4]
        findings = check(
            *(
                column(v if digits is None else rounded(v, digits), law)
                for v, law in zip(values, laws, strict=True)
            ),
            risk=0.01,
        )
        wrong += findings.too_far != () or findings.too_close != () or findings.equal is not None
        wrong += findings.correlations != () or findings.missing != ()
    assert wrong <= 3  # 0.6 expected at most
