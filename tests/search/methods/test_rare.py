"""Subset simulation, and the estimates made of it, on probabilities that are known."""

import numpy as np
import pytest
from scipy.stats import norm
from search.methods import known_probabilities as known

from abhv_mc.search.methods.rare import estimate_rare, noise_share
from abhv_mc.search.methods.second_opinion import find_failures, sample_importance
from abhv_mc.search.methods.strata import MOST_COMBINATIONS, estimate_switched, list_combinations
from abhv_mc.search.methods.subset import SubsetPlan, run_subset

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


def test_batches_fill_lanes_and_flights_are_counted():
    sizes = []

    def counted(points):
        sizes.append(len(points))
        return points[:, 0]

    repetitions = run_subset(counted, SubsetPlan(3, 4.0, 1), range(4), 100_000)
    assert all(size % 32 == 0 for size in sizes)
    assert sum(sizes) == sum(repetition.flights for repetition in repetitions)


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
