"""Subset simulation, and the estimates made of it, on probabilities that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.stats import norm
from search.methods import known_probabilities as known

from abhv_mc.search.methods.rare import choose_chains, estimate_rare, noise_share
from abhv_mc.search.methods.second_opinion import (
    ImportanceEstimate,
    find_failures,
    sample_importance,
)
from abhv_mc.search.methods.strata import MOST_COMBINATIONS, estimate_switched, list_combinations
from abhv_mc.search.methods.subset import Level, Repetition, SubsetPlan, run_subset
from abhv_mc.statistics.binomial import clopper_pearson

SEEDS = 3


def estimate(case, seed, **options):
    return estimate_rare(case.severity, SubsetPlan(case.dimension, case.threshold, seed), **options)


def test_right_within_its_interval():
    """Run a small sample of benchmarks/rare_coverage.py.

    The benchmark has 200 seeds for each case, including held-out cases.
    """
    right = refused = count = 0
    for case in (
        known.linear(50, 5.1993),
        known.ball(50, 1e-4),
        known.paraboloid(40, 0.3626, -0.15),
        known.four_branch(4.0),
        known.onion(2, 4.9),
        known.series(50, 50, 5.0),
        known.parallel(24, 3, 2.0),
        *known.held_out_cases(),
    ):
        for seed in range(SEEDS):
            result = estimate(case, 1000 + seed)
            count += 1
            refused += result.refusal is not None
            right += result.refusal is None and result.low <= case.probability <= result.high
            assert result.flights <= 20_000
    assert right >= 0.9 * count
    assert refused <= 0.1 * count


def interval_of(repetitions, number=None):
    """Return mean, low and high: Student's interval of the logarithm, for `number` repetitions."""
    logs = np.log([repetition.probability for repetition in repetitions])
    chains = np.mean([sum(level.cov**2 for level in own.levels) for own in repetitions])
    own, number = len(logs) - 1, number or len(logs)
    # The chains count as four repetitions, with 1.3 times their standard deviation.
    variance = (4.0 * 1.3**2 * chains + own * logs.var(ddof=1)) / (4 + own)
    half = stats.t.ppf(0.975, 4 + number - 1) * np.sqrt(variance / number)
    mean = np.exp(logs).mean()
    return mean, mean * np.exp(-half), min(mean * np.exp(half), 1.0)


@pytest.mark.parametrize(("target_cov", "flights"), [(0.2, 20_000), (0.1, 40_000), (0.1, 16_000)])
def test_the_interval_is_students_of_the_repetitions_that_it_needs(target_cov, flights):
    sizes, case = [], known.linear(25, 3.5)

    def severity(points):
        sizes.append(len(points))
        return case.severity(points)

    plan = SubsetPlan(25, case.threshold, 5)
    result = estimate_rare(severity, plan, target_cov, flights)
    found = result.repetitions
    assert result.refusal is None and result.check is None and result.flights == sum(sizes)
    assert (result.probability, result.low, result.high) == pytest.approx(interval_of(found))
    estimates = np.array([repetition.probability for repetition in found])
    assert result.cov == pytest.approx(stats.variation(estimates, ddof=1) / len(found) ** 0.5)
    assert [repetition.number for repetition in found] == [*range(len(found))]
    needed = result.high / result.probability <= np.exp(1.96 * target_cov) * (1.0 + 1e-4)
    assert needed == (flights >= 20_000) and len(found) >= 4
    assert needed or flights - sum(sizes) < max(repetition.flights for repetition in found)
    assert result.plain == (sum(own.plain_failures for own in found), 640 * len(found))
    high = clopper_pearson(*result.plain, 0.9)[1]
    assert result.unwarned_high == pytest.approx(high)
    assert result.include_unwarned().high == max(result.high, high)
    assert len(result.failures) == sum(np.sum(own.values > 3.5) for own in found)


def made_repetition(probability, cov, flights=20_001, **state):
    level = Level(1.0, probability, cov, 0.4, 0.5)
    values = np.arange(10.0)
    return Repetition(0, values[:, None], values, flights, 0, [level], **{"reached": True, **state})


@pytest.mark.parametrize(
    ("repetitions", "is_refused"),
    [
        ([(1e-3, 0.3)] * 4, False),
        ([(1e-3, 0.98)] * 4, False),  # exp(2 t 1.3 cov / 7**0.5) = 9.8, and 10.3
        ([(1e-3, 1.0)] * 4, True),
        # The ratio of standard deviations is at most 2 (chi2.isf(0.001, 3) / 3)**0.5 = 4.66.
        ([(1e-3 * np.exp(sign * 0.2), 0.05) for sign in (1, -1, 1, -1)], False),
        ([(1e-3 * np.exp(sign * 0.203), 0.05) for sign in (1, -1, 1, -1)], True),
    ],
)
def test_repetitions_that_contradict_each_other_are_refused(monkeypatch, repetitions, is_refused):
    made = [made_repetition(*entry) for entry in repetitions]
    monkeypatch.setattr("abhv_mc.search.methods.rare.run_subset", lambda *_: [*made])
    result = estimate_rare(first, SubsetPlan(25, 1.0, 0))
    assert (result.refusal is not None) == is_refused
    assert (result.probability, result.low, result.high) == pytest.approx(interval_of(made))
    for state in ({"reached": False}, {"cut_short": True}):
        made[1] = made_repetition(1e-3, 0.3, **state)
        assert estimate_rare(first, SubsetPlan(25, 1.0, 0)).refusal is not None


@pytest.mark.parametrize(("size", "fitting"), [(500, 35), (4000, 4)])
def test_as_many_repetitions_are_added_as_are_needed_or_fit(monkeypatch, size, fitting):
    """A tenth of the flights, in whole lanes, is left for importance sampling."""
    asked, made = [], [made_repetition(1e-3, 0.3, size) for _ in range(4)]

    def run(evaluate, plan, numbers, flights, fewest=0):
        asked.append(([*numbers], flights, fewest))
        return made[:1] * len(numbers)

    monkeypatch.setattr("abhv_mc.search.methods.rare.run_subset", run)
    check = ImportanceEstimate(1e-3, 0.1, 1.0, 2016)
    monkeypatch.setattr("abhv_mc.search.methods.rare.sample_importance", lambda *_: check)
    estimate_rare(first, SubsetPlan(15, 1.0, 0), 0.1)
    limit = 1e-3 * np.exp(0.1 * norm.ppf(0.975))
    enough = next(n for n in range(4, 99) if interval_of(made, n)[2] <= limit)
    assert asked[0] == ([0, 1, 2, 3], 20_000, 4)
    assert asked[1] == ([*range(4, min(enough, 4 + fitting))], 20_000 - 2016, 0)
    assert [choose_chains(n) for n in (100, 20_000, 59_999, 10**6)] == [32, 64, 160, 256]


@pytest.mark.parametrize(
    ("factor", "effective", "is_replaced", "is_refused", "is_raised"),
    [
        (1.05, 200.0, False, False, True),
        (3.0, 7.9, False, False, False),  # too few failures for any conclusion
        (3.0, 29.0, False, True, True),
        (3.0, 30.0, True, False, True),
        (0.3, 99.0, False, False, False),
        (0.3, 100.0, False, True, False),
    ],
)
def test_importance_sampling_raises_replaces_or_refuses_an_estimate(
    monkeypatch, factor, effective, is_replaced, is_refused, is_raised
):
    made = [made_repetition(1e-3, 0.1) for _ in range(4)]
    monkeypatch.setattr("abhv_mc.search.methods.rare.run_subset", lambda *_: [*made])

    def estimate_with(factor, effective):
        check = ImportanceEstimate(factor * 1e-3, 0.1, effective, 4096)
        monkeypatch.setattr("abhv_mc.search.methods.rare.sample_importance", lambda *_: check)
        return estimate_rare(first, SubsetPlan(15, 9.0, 2))

    probability, low, high = interval_of(made)
    result = estimate_with(factor, effective)
    end = np.exp(norm.ppf(0.975) * 1.5 * 0.1)
    assert (result.check.effective, result.refusal is not None) == (effective, is_refused)
    if is_replaced:
        probability, low = factor * 1e-3, factor * 1e-3 / end
    raised = max(high, factor * 1e-3 * end) if is_raised else high
    numbers = result.probability, result.low, result.high, result.cov
    cov = pytest.approx(0.15 * is_replaced, abs=1e-12)
    assert numbers == (*map(pytest.approx, (probability, low, raised)), cov)
    # A contradiction is a ratio beyond three standard deviations.
    edge = np.exp(3.0 * np.hypot(0.1, np.log(high / interval_of(made)[1]) / 3.92))
    for ratio in (0.99, 1.01):
        assert (estimate_with(ratio * edge, 29.0).refusal is not None) == (ratio > 1.0)
        assert (estimate_with(1.0 / ratio / edge, 100.0).refusal is not None) == (ratio > 1.0)


def test_refused_where_the_event_is_never_met():
    result = estimate_rare(lambda u: np.minimum(u[:, 0], 0.0), SubsetPlan(25, 1.0, 0))
    assert result.refusal is not None and "repetition" in result.refusal
    assert (result.low, result.high) == (0.0, 1.0)


def test_refused_where_only_some_repetitions_meet_it():
    """Estimate if the gradient leads to a plateau on the wrong side.

    The event is on the other side, which is less severe until close to it.
    """

    def severity(u):
        right = np.where(u[:, 0] < 1.7, 2.0 * u[:, 0], 3.4 + 0.01 * u[:, 0])
        return np.maximum(right, -u[:, 0])

    estimates = [estimate_rare(severity, SubsetPlan(25, 3.5, seed)) for seed in range(6)]
    accepted = [item for item in estimates if item.refusal is None]
    assert len(accepted) <= 1 and all(item.low <= norm.sf(3.5) <= item.high for item in accepted)


def test_refused_where_the_event_is_too_rare_for_the_flights():
    result = estimate_rare(lambda u: u[:, 0], SubsetPlan(25, 6.0, 0), flights=8_000)  # 1e-9
    assert result.refusal is not None and " 4 " in result.refusal
    assert result.flights <= 8_000


def test_importance_sampling_of_two_places():
    case = known.four_branch(4.0)
    result = estimate(case, 3)
    assert result.check is not None and result.check.effective >= 100
    assert result.check.probability == pytest.approx(case.probability, rel=0.15)
    again = sample_importance(case.severity, case.threshold, result.failures, 4096, 11)
    assert again.probability == pytest.approx(case.probability, rel=4.0 * again.cov)
    assert again.cov < 0.1


@pytest.mark.parametrize("dimension", [2, 5, 10])
def test_both_branches_are_found(dimension):
    case = known.masked(dimension)
    failures = find_failures(case.severity, dimension, case.threshold, 3.4e-6, 3)
    steep = failures[:, 1] > 4.0
    assert 0.2 < np.mean(steep) < 0.98 and np.all(case.severity(failures) > 0.0)


@pytest.mark.parametrize("case, first", [(known.masked(5), 1000), (known.corner(4), 5000)])
def test_an_estimate_of_the_gradual_branch_alone_is_hardly_given(case, first):
    """Check that few intervals are wholly below the true value.

    Without a second look 95 % of the one case were; without the larger of both ends 4 of these 10
    of the other. More seeds are in benchmarks/rare_coverage.py --missed.
    """
    estimates = [
        estimate_rare(case.severity, SubsetPlan(case.dimension, 0.0, first + seed))
        for seed in range(10)
    ]
    accepted = [item for item in estimates if item.refusal is None]
    assert accepted and sum(item.high < case.probability for item in accepted) <= 1


def test_the_interval_reaches_to_failures_that_are_random():
    """Check that the interval includes failures that are random.

    Without them 25 of 27 accepted intervals were wholly below the true value; more seeds are in
    benchmarks/rare_coverage.py --missed.
    """
    below = accepted = 0
    for seed in range(6):
        case = known.random_crash(seed)
        result = estimate_rare(case.severity, SubsetPlan(2, 0.0, seed))
        wide = result.include_unwarned()
        assert wide.high >= max(result.high, result.unwarned_high) and wide.low == result.low
        accepted += result.refusal is None
        below += result.refusal is None and wide.high < case.probability
    assert accepted >= 3 and below == 0


def test_the_share_of_noise_is_that_of_ranks():
    draw = np.random.default_rng(1)
    severity = draw.standard_normal(4000)
    noisy = tuple(severity + draw.standard_normal(4000) for _ in range(2))
    # Ranks of normal numbers with correlation r correlate with 6 asin(r/2) / pi.
    assert noise_share(noisy) == pytest.approx(1.0 - 6.0 * np.arcsin(0.25) / np.pi, abs=0.03)
    assert noise_share((severity, severity)) == 0.0
    lost = np.where(severity > 1.0, 1e9, severity)
    assert noise_share((lost, lost)) == 0.0


def test_beyond_dimension_10_plain_flights_bound_what_fails_without_warning():
    case = known.corner(12)
    for seed in range(3):
        result = estimate_rare(case.severity, SubsetPlan(12, 0.0, seed))
        failures, flights = result.plain
        assert flights == 640 * len(result.repetitions) and result.unwarned_high > case.probability
        if not failures:
            assert result.unwarned_high == pytest.approx(1.0 - 0.05 ** (1.0 / flights))


@pytest.mark.parametrize("case", known.switched_cases(), ids=lambda case: case.name)
def test_rare_switches_are_counted(case):
    """Check that cases with switches get estimates.

    Formerly all were rejected for two switches, 10 of 24 for eight; more seeds are in
    benchmarks/rare_coverage.py --missed.
    """
    accepted = below = 0
    for seed in range(4):
        result, strata = estimate_switched(case.severity, case.rates, SubsetPlan(4, 0.0, seed))
        accepted, below = (
            accepted + (result.refusal is None),
            below + (result.refusal is None and result.high < case.probability),
        )
        assert (
            result.flights <= 20_000
            and sum(stratum.flights for stratum in strata) == result.flights
        )
        assert sum(stratum.weight for stratum in strata) == pytest.approx(1.0, abs=1e-9)
        assert (strata[-1].on is None) == (2 ** len(case.rates) > MOST_COMBINATIONS)
    assert accepted >= 3 and below == 0


def test_what_plain_flights_see_takes_no_levels():
    """Estimate with a switch of 5 % that always fails.

    Few flights are left for a pilot of 32 combinations and of all others.
    """
    case = known.switched(1, 0.05, 8.0, fatal=1)
    result, _ = estimate_switched(case.severity, case.rates, SubsetPlan(3, 0.0, 1))
    assert (
        not result.repetitions and result.unwarned_high is None and result.low < 0.05 < result.high
    )
    assert result.flights < 2000
    many = known.switched(8, 2e-3, 4.0, fatal=1)
    assert (
        estimate_switched(many.severity, many.rates, SubsetPlan(3, 0.0, 1, 32), flights=1280)[
            0
        ].flights
        <= 1280
    )


@pytest.mark.parametrize(
    "case",
    [
        known.switched(1, 0.05, 8.0, fatal=1),
        known.switched(2, 0.3, 2.5, 0.5),
        known.switched(8, 2e-3, 2.0, fatal=1),
        known.switched(2, 0.1, 9.0),  # no failure
    ],
    ids=lambda case: case.name,
)
def test_the_total_is_the_sum_of_the_combinations_and_their_exact_intervals(case):
    result, strata = estimate_switched(
        case.severity, case.rates, SubsetPlan(2, 0.0, 4), flights=6400
    )
    listed = list_combinations(case.rates)[:MOST_COMBINATIONS]
    assert [(own.on, own.weight) for own in strata if own.on is not None] == listed
    below, above, clean = [], [], [0.0]
    for own in strata:
        failures = round(own.probability * own.flights)
        low, high = clopper_pearson(failures, own.flights)
        assert (own.probability, own.low, own.high) == pytest.approx(
            (failures / own.flights, low, high)
        )
        assert own.value == own.weight * own.probability
        below.append(own.weight * (own.probability - low))
        if failures:
            above.append(own.weight * (high - own.probability))
        else:
            clean.append(-own.weight * np.log(1.0 - high))
    total = sum(own.value for own in strata)
    low, high = total - np.linalg.norm(below), total + np.linalg.norm([*above, max(clean)])
    assert (result.probability, result.low, result.high) == pytest.approx((total, low, high))
    assert result.cov == (pytest.approx((high - low) / 3.92 / total) if total else np.inf)
    assert (result.refusal is not None) == (high > 10.0 * low)
    assert result.flights == sum(own.flights for own in strata) <= 6400


@pytest.mark.parametrize(
    ("rate", "target_cov", "is_used"),
    [(0.014, 0.2, True), (0.0145, 0.2, False), (0.028, 0.1, True), (0.0285, 0.1, False)],
)
def test_levels_are_used_unless_2560_plain_flights_are_enough(
    monkeypatch, rate, target_cov, is_used
):
    """Enough are 3.7 (1 - rate) / (0.5 cov rate), if all flights with the switch fail."""
    budgets, made = [], estimate_rare(first, SubsetPlan(25, 1.0, 0), flights=2560)

    def estimate_main(evaluate, plan, cov, flights):
        budgets.append(flights)
        return made

    monkeypatch.setattr("abhv_mc.search.methods.strata.estimate_rare", estimate_main)
    case = known.switched(1, rate, 99.0, fatal=1)
    result, strata = estimate_switched(
        case.severity, case.rates, SubsetPlan(1, 0.0, 4), target_cov, 20_000
    )
    assert budgets == [15_000] * is_used
    assert result.repetitions == (made.repetitions if is_used else ())
    if is_used:
        assert (strata[0].probability, strata[0].low) == (made.probability, made.low)
        assert strata[0].flights == 64 + made.flights and strata[0].high == made.high


def test_a_refused_estimate_of_the_main_combination_counts_its_plain_flights(monkeypatch):
    made = estimate_rare(first, SubsetPlan(25, 9.0, 0), flights=5000)
    assert made.refusal is not None and made.flights - made.plain[1] == 4 * 576
    made = replace(made, refusal="too rare")
    monkeypatch.setattr("abhv_mc.search.methods.strata.estimate_rare", lambda *_: made)
    case = known.switched(2, 0.1, 99.0)
    result, strata = estimate_switched(case.severity, case.rates, SubsetPlan(1, 0.0, 4), 0.2, 6400)
    plain = strata[0].flights - 4 * 576
    assert plain >= 64 + made.plain[1] and strata[0].high == clopper_pearson(0, plain)[1]
    assert result.probability == 0.0 and result.cov == np.inf and "too rare" in result.refusal


def test_combinations_come_by_weight():
    listed = list_combinations(np.array([0.1, 0.4]))
    assert [on for on, _ in listed] == [(), (1,), (0,), (0, 1)]
    assert [weight for _, weight in listed] == pytest.approx([0.54, 0.36, 0.06, 0.04])


def first(points):
    return points[:, 0]


def test_the_same_whatever_runs_beside_it():
    plan = SubsetPlan(3, 3.0, 7)
    together = run_subset(first, plan, range(4), 100_000)
    alone = run_subset(first, plan, range(2, 3), 100_000)[0]
    np.testing.assert_array_equal(together[2].points, alone.points)
    assert together[2].levels == alone.levels


def test_levels_begin_at_the_tenth_of_the_most_severe_points():
    seen = []

    def severity(points):
        seen.append(points[:, 0])
        return points[:, 0]

    repetitions = run_subset(severity, SubsetPlan(3, 3.0, 1), range(4), 100_000)
    for repetition, values in zip(repetitions, seen[0].reshape(4, 640), strict=True):
        start, *_, before, last = repetition.levels
        assert (start.threshold, start.probability) == (np.sort(values)[576], 0.1)
        assert (start.acceptance, start.spread) == (1.0, 1.0)
        assert start.cov == pytest.approx((0.9 / 64.0) ** 0.5)
        assert repetition.plain_failures == np.sum(values > 3.0)
        assert (
            last.threshold == 3.0 > before.threshold and repetition.values.min() >= before.threshold
        )
        inside = repetition.values.reshape(10, 64) > 3.0
        share, steps = inside.mean(), np.arange(1, 10)
        lags = [np.mean(inside[k:] & inside[: 10 - k]) - share**2 for k in steps]
        inflation = 1.0 + 2.0 * np.sum((1.0 - steps / 10.0) * lags) / (share * (1.0 - share))
        assert last.probability == share
        assert last.cov == pytest.approx(
            ((1.0 - share) / share / 640.0 * max(inflation, 1.0)) ** 0.5
        )
        points = repetition.points.reshape(10, 64, 3)
        moved = (points[1:] != points[:-1]).any(axis=2)
        assert last.acceptance == pytest.approx(moved.mean()) == pytest.approx(0.44, abs=0.1)
        assert np.array_equal(repetition.points[:, 0], repetition.values)
        assert np.array_equal(repetition.failures, repetition.points[repetition.values > 3.0])
        shares = [level.probability for level in repetition.levels]
        assert repetition.reached and repetition.probability == pytest.approx(np.prod(shares))
        assert repetition.flights == 640 + 576 * (len(shares) - 1)
        assert repetition.cov**2 == pytest.approx(sum(level.cov**2 for level in repetition.levels))


def test_batches_fill_lanes_and_flights_are_counted():
    sizes = []

    def counted(points):
        sizes.append(len(points))
        return points[:, 0]

    repetitions = run_subset(counted, SubsetPlan(3, 4.0, 1), range(4), 100_000)
    assert all(size % 32 == 0 for size in sizes)
    assert sum(sizes) == sum(repetition.flights for repetition in repetitions)


def test_at_most_twelve_levels_are_tried():
    (repetition,) = run_subset(first, SubsetPlan(1, 99.0, 0, 32), range(1), 10**6)
    assert len(repetition.levels) == 12 and repetition.flights == 320 + 11 * 288
    assert not repetition.reached and not repetition.cut_short and repetition.probability == 0.0
    assert not len(repetition.failures)


def test_flights_that_do_not_suffice_drop_the_last_repetitions():
    plan = SubsetPlan(2, 4.5, 0)
    repetitions = run_subset(first, plan, range(6), 6 * 640 + 6 * 4 * 576 + 3 * 576)
    assert [repetition.number for repetition in repetitions] == list(range(len(repetitions)))
    assert 0 < len(repetitions) < 6
    full = run_subset(first, plan, range(6), 10**6)
    assert [repetition.probability for repetition in repetitions] == [
        repetition.probability for repetition in full[: len(repetitions)]
    ]


def test_where_too_few_would_be_left_all_end_as_cut_short():
    repetitions = run_subset(
        first, SubsetPlan(2, 4.5, 0), range(6), 6 * 640 + 6 * 2 * 576 + 3 * 576, fewest=4
    )
    assert len(repetitions) == 4
    assert all(repetition.cut_short and not repetition.reached for repetition in repetitions)
