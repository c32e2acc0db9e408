"""Planted drivers are found among idle ones, and none is found where there is none."""

from itertools import chain, combinations, product

import numpy as np
import openturns
import pytest
from scipy import stats

from abhv_mc.campaign.sampling.marginals import ContinuousMarginal
from abhv_mc.statistics.drivers import _permute, given_data_indices, rank_drivers
from abhv_mc.statistics.failure_rules import bin_inputs, find_rules, hypergeometric_tail
from abhv_mc.statistics.ranks import average_ranks, false_discovery

IDLE, FLIGHTS = 30, 400


def _inputs(seed):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (FLIGHTS, IDLE + 2))


def test_coefficients_and_p_values_are_those_of_openturns_and_scipy():
    draw = np.random.default_rng(12)
    inputs = draw.normal(size=(100, 3))
    inputs[:, 1] += 0.8 * inputs[:, 0]
    output = np.exp(inputs @ [1.0, -0.3, 0.1]) + draw.normal(size=100)
    drivers = rank_drivers(inputs, output[:, None])
    theirs = openturns.CorrelationAnalysis(inputs, output[:, None])
    assert drivers.srrc[:, 0] == pytest.approx(np.array(theirs.computeSRRC()), abs=1e-12)
    for j in range(3):  # a coefficient's t-test is that of the partial correlation
        partial = theirs.computePRCC()[j]
        t = partial * np.sqrt(96.0 / (1.0 - partial**2))
        assert drivers.p_value[j, 0] == pytest.approx(2.0 * stats.t.sf(abs(t), 96), rel=1e-9)


def test_a_tiny_coefficient_names_no_driver_and_noise_hides_none():
    """Check the significance of drivers.

    An SRRC of 0.01 was named if 5000 flights made it significant; noise hid a linear driver.
    """
    draw = np.random.default_rng(90)
    inputs = draw.uniform(-1.0, 1.0, (5000, 3))
    outputs = [inputs @ [1.0, 0.02, 0.0], inputs[:, 0] + 1.5 * draw.normal(size=5000)]
    drivers = rank_drivers(inputs, np.column_stack(outputs))
    assert drivers.p_value[1, 0] < 1e-6 and abs(drivers.srrc[1, 0]) < 0.05
    assert drivers.explained[1] < 0.2
    assert drivers.found.T.tolist() == [[True, False, False], [True, False, False]]


@pytest.mark.parametrize("correlated", ["none", "pair", "idle"])
def test_noise_hides_neither_true_drivers_nor_their_correlation(correlated):
    """Check two drivers below half of the variance.

    Four drivers are correlated with an input without effect.
    """
    covariance = np.eye(5)
    if correlated == "pair":
        covariance[0, 1] = covariance[1, 0] = 0.5
    elif correlated == "idle":
        covariance[4, :4] = covariance[:4, 4] = 0.29
    for seed in range(3):
        draw = np.random.default_rng(seed)
        x = draw.multivariate_normal(np.zeros(5), covariance, 2000)
        noise = draw.normal(size=(2000, 2)) * [1.5, 2.3]
        outputs = x @ np.transpose([[1.0, 0.8, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0, 0.0]]) + noise
        drivers = rank_drivers(np.hstack([x, np.abs(x)]), outputs)
        assert [np.flatnonzero(named).tolist() for named in drivers.found.T] == [
            [0, 1],
            [0, 1, 2, 3],
        ]
        assert not given_data_indices(x, drivers.residuals).found.any()


@pytest.mark.parametrize("together", [0.5, 0.8, 0.95])
def test_an_idle_partner_of_a_driver_is_not_named(together):
    """Check an input without effect.

    It was named in 16 to 100 % of campaigns of 5000 flights: a curved output biases its ranks.
    """
    named = marked = 0
    for seed in range(12):
        draw = np.random.default_rng(5000 + seed)
        inputs = draw.normal(size=(5000, 4))
        inputs[:, 1] = together * inputs[:, 0] + np.sqrt(1.0 - together**2) * inputs[:, 1]
        curved = inputs[:, 0] ** 2 + inputs[:, 0] + 0.3 * draw.normal(size=5000)
        steady = np.exp(inputs[:, 0]) + inputs[:, 0] ** 3 + 0.3 * draw.normal(size=5000)
        drivers = rank_drivers(
            np.hstack([inputs, np.abs(inputs)]), np.column_stack([curved, steady])
        )
        assert drivers.found[0, 1] and drivers.found[[0, 4]].any(axis=0).all()
        named += drivers.found[[1, 5]].any()
        marked += drivers.moves_with[1, 1] == 0
    assert named <= 1 and marked >= 11


def test_intervals_cover_the_coefficients_of_all_flights():
    """Also if nearly everything is explained: there the ranks' own scatter is most of the error."""
    draw = np.random.default_rng(92)

    def run(number):
        inputs = draw.uniform(-1.0, 1.0, (number, 3))
        noise = np.column_stack([1.0 + inputs[:, 0], np.full(number, 0.02)])
        return inputs, (inputs @ [1.0, 0.5, 0.1])[:, None] + noise * draw.normal(size=(number, 2))

    truth = rank_drivers(*run(400_000)).srrc
    missed = 0
    for _ in range(100):
        drivers = rank_drivers(*run(200))
        missed += (drivers.srrc_low > truth) | (drivers.srrc_high < truth)
    assert missed.mean() <= 0.08 * 100 and missed.max() <= 0.12 * 100


@pytest.mark.parametrize(("flights", "resampled"), [(60, 60), (1500, 1000)])
def test_intervals_are_bootstrapped_with_ranks_of_ties_averaged(flights, resampled):
    draw = np.random.default_rng(6)
    values = draw.normal(size=(flights, 4))
    values[:, 1], values[:, 3] = draw.integers(0, 3, flights), np.round(values[:, :3].sum(axis=1))
    values[:, 2] += values[:, 0]
    drivers = rank_drivers(values[:, :3], values[:, 3:], 0.9)
    correlation = np.corrcoef(stats.rankdata(values, axis=0).T)
    slopes = np.linalg.solve(correlation[:3, :3], correlation[:3, 3])
    assert drivers.srrc[:, 0] == pytest.approx(slopes, abs=1e-12)
    random, steps = np.random.default_rng(0), []
    for _ in range(300):
        sample = values[random.integers(resampled, size=resampled)]
        x, y = np.split(stats.zscore(stats.rankdata(sample, axis=0)), [3], axis=1)
        step = x.T @ (y[:, 0] - x @ slopes) / resampled
        steps.append(np.linalg.solve(correlation[:3, :3], step))
    half = stats.norm.ppf(0.95) * np.std(steps, axis=0, ddof=1) * (resampled / flights) ** 0.5
    assert drivers.srrc_high[:, 0] - slopes == pytest.approx(half, rel=1e-9)
    assert slopes - drivers.srrc_low[:, 0] == pytest.approx(half, rel=1e-9)


def test_constant_output_and_input_are_not_judged():
    inputs = np.column_stack([np.linspace(0.0, 1.0, 50), np.ones(50)])
    drivers = rank_drivers(inputs, np.column_stack([np.zeros(50), np.linspace(0.0, 1.0, 50) ** 3]))
    assert np.isnan(drivers.srrc[:, 0]).all()
    assert drivers.srrc[0, 1] == pytest.approx(1.0)
    assert not drivers.found[1].any()


@pytest.mark.parametrize(
    ("output", "kind"),
    [
        (lambda x, draw: draw.random(500) < 0.2, None),
        (lambda x, draw: draw.random(500) < 0.01, None),
        (lambda x, draw: draw.poisson(0.3, 500), None),
        (lambda x, draw: np.where(draw.random(500) < 0.05, np.inf, x), 0),
        (lambda x, draw: np.maximum(x - 1.0, 0.0), 0),
        (lambda x, draw: np.maximum(np.abs(x) - 1.0, 0.0), 1),
    ],
)
def test_ties_name_no_idle_input_and_change_no_kind_of_effect(output, kind):
    """Constant, counted and clipped metrics named idle inputs, because residuals were ranked."""
    wrong = 0
    for seed in range(8):
        draw = np.random.default_rng(600 + seed)
        x = draw.standard_normal((500, 3))
        folded = np.abs(x - np.median(x, axis=0))
        drivers = rank_drivers(x, output(x[:, 0], draw)[:, None], folded=folded)
        remainder = given_data_indices(x, drivers.residuals).found
        named = np.vstack([drivers.found.reshape(2, 3), remainder.T])
        assert kind is None or named[kind, 0]
        wrong += named.sum() > (kind is not None)
    assert wrong <= 1


def test_a_weak_driver_is_named_with_its_folded_term():
    """It explains 7 % of the variance, less than the share from which curves are named."""
    draw = np.random.default_rng(5)
    x = draw.standard_normal((2000, 3))
    y = 0.27 * x[:, :1] + draw.standard_normal((2000, 1))
    found = rank_drivers(x, y, folded=np.abs(x - np.median(x, axis=0))).found
    assert found[:, 0].tolist() == [True, *5 * [False]]


def _corner(inputs, chance, seed):
    draw = np.random.default_rng(seed).random(FLIGHTS)
    return (inputs[:, 4] > 0.4) & (inputs[:, 9] < -0.2) & (draw < chance)


def rules_for(inputs, failed):
    """Return the rules for inputs [flight, input] that are named by their columns."""
    names = [str(column) for column in range(inputs.shape[1])]
    return find_rules(bin_inputs(names, lambda name: inputs[:, int(name)]), failed)


def test_a_difference_rides_on_no_real_input():
    """One input alone, and a corner, stay what they are."""
    for seed in range(10):
        inputs = _inputs(7200 + seed)
        for failed in (inputs[:, 4] > 0.7, _corner(inputs, 0.9, 7300 + seed)):
            rules = rules_for(inputs, failed)
            assert rules and not any(
                c.minus is not None for rule in rules[:1] for c in rule.conditions
            )
            assert {c.parameter for c in rules[0].conditions} <= {"4", "9"}


LEVELS = [0.01, 0.02, 0.05, *np.arange(1, 10) / 10.0, 0.95, 0.98, 0.99]


def excess(region, failed):
    """Return the failures in a region above their mean, in standard deviations."""
    flights, size, failures, bad = (
        failed.size,
        *map(np.count_nonzero, (region, failed, region & failed)),
    )
    mean = failures * size / flights
    variance = mean * (1.0 - size / flights) * (flights - failures) / (flights - 1)
    return round((bad - mean) / variance**0.5, 9) if variance else -np.inf


def tail(region, failed):
    return stats.hypergeom.sf((region & failed).sum() - 1, failed.size, failed.sum(), region.sum())


def half_lines(values, levels, *names):
    """Return those below and then above each quantile, with a mask of the flights."""
    edges = np.quantile(values, levels).tolist()
    sides = [(above, edge) for above in (False, True) for edge in edges]
    return [((*names, *side), (values > side[1]) == side[0]) for side in sides]


def given(a, b, failed):
    """Return region `a` and the failures among the flights in `b`, and the other way round."""
    return (a[b], failed[b]), (b[a], failed[a])


def along(values, failed, tried, *names):
    """Return the best half-lines, or both ends: p-value, conditions, flights."""
    lines = half_lines(values, LEVELS, *names)
    best = [max(lines[k : k + 15], key=lambda line: excess(line[1], failed)) for k in (0, 15)]
    found = [(15 * tried * tail(mask, failed), [side], mask, False) for side, mask in best]
    ends = [(low, high) for k, low in enumerate(lines[:15]) for high in lines[16 + k :]]
    low, high = max(ends, key=lambda pair: excess(pair[0][1] | pair[1][1], failed))
    parts = (low[1][~high[1]], failed[~high[1]]), (high[1][~low[1]], failed[~low[1]])
    both = 105 * tried * tail(low[1] | high[1], failed)
    if (
        min(excess(*part) for part in parts) >= 2.0
        and 105 * tried * max(tail(*part) for part in parts) <= 0.05
        and both < min(found)[0]
    ):
        return [(both, [low[0], high[0]], low[1] | high[1], True)]
    return found


def sharpen(values, above, threshold, failed):
    """Move a threshold by at most 5 % of 400 flights to separate failures from others."""
    ordered, worth = np.sort(values)[:: -1 if above else 1], {}
    for count in np.sum((values > threshold) == above) + np.arange(-20, 21):
        if 1 <= count < 400:
            middle = ordered[count - 1 : count + 1].mean()
            region = (values > middle) == above
            worth[middle] = round(region[failed].mean() - region[~failed].mean(), 12)
    return max(worth, key=worth.get)


def rules_of_the_definition(x, failed):
    """Return conditions, failures and others inside, p-value, q-value and `either` of each rule."""
    pairs = [*combinations(range(len(x)), 2)]
    lines = {k: along(values, failed, 1, str(k), None) for k, values in enumerate(x)}
    corners, differences = [], []
    for i, j in pairs:
        a, b = max(
            product(*(half_lines(x[k], LEVELS[3:12], str(k), None) for k in (i, j))),
            key=lambda sides: min(
                excess(*part) for part in given(sides[0][1], sides[1][1], failed)
            ),
        )
        p_value = 324 * max(tail(*part) for part in given(a[1], b[1], failed))
        corners.append((p_value, [a[0], b[0]], a[1] & b[1], False))
        best = min(324 * tail(a[1] & b[1], failed), min(lines[i])[0], min(lines[j])[0])
        standard = stats.zscore(x[i]) - stats.zscore(x[j])
        tried = along(standard, failed, len(pairs), str(i), str(j))
        differences += [entry for entry in tried if entry[0] < min(best, 1.0)]
    candidates = [*chain(*lines.values()), *corners, *differences]
    p_values = np.minimum([entry[0] for entry in candidates], 1.0)
    q_values = stats.false_discovery_control(p_values)
    rules = []
    for p, q, (_, sides, mask, either) in zip(p_values, q_values, candidates, strict=True):
        moved, region = sides, mask
        if len(sides) == 1 or either:
            moved, region = [], np.zeros(400, bool)
            for name, minus, above, threshold in sides:
                own = x[int(name)]
                if minus:
                    own = stats.zscore(own) - stats.zscore(x[int(minus)])
                moved.append((name, minus, above, sharpen(own, above, threshold, failed)))
                region |= (own > moved[-1][3]) == above
        if q <= 0.05:
            inside = (region & failed).sum(), (region & ~failed).sum()
            rules.append((moved, *inside, p, q, either))
    return sorted(rules, key=lambda rule: (rule[3], len(rule[0])))


@pytest.mark.parametrize(
    "chance",
    [
        lambda x, y, z: 0.4 * (x > 0.7) + 0.5 * (z < 0.1),
        lambda x, y, z: 0.6 * (abs(x - 0.5) > 0.42) + 0.25 * (y < 0.2),
        lambda x, y, z: 0.9 * (x > 0.7) * (y < 0.3),
        lambda x, y, z: 0.6 * (x - z > 0.5) + 0.1 * (y > 0.5),
        lambda x, y, z: 0.7 * (abs(x - z) > 0.6),
    ],
    ids=["lines", "ends", "corner", "difference", "distance"],
)
def test_rules_are_those_of_trying_all_regions_one_by_one(chance):
    draw = np.random.default_rng(97)
    x = draw.random((3, 400))
    failed = draw.random(400) < chance(*x)
    expected, found = rules_of_the_definition(x, failed), rules_for(x.T, failed)
    assert len(found) == len(expected) > 0
    for rule, (sides, bad, others, p, q, either) in zip(found, expected, strict=True):
        assert [(c.parameter, c.minus, c.above) for c in rule.conditions] == [
            side[:3] for side in sides
        ]
        assert [c.threshold for c in rule.conditions] == pytest.approx([s[3] for s in sides])
        assert (rule.failures_inside, rule.others_inside, rule.either) == (bad, others, either)
        assert (rule.failures, rule.others) == (failed.sum(), 400 - failed.sum())
        assert (rule.p_value, rule.q_value) == pytest.approx((p, q), rel=1e-6, abs=0.0)


def test_only_differences_of_the_six_inputs_most_related_to_failures_are_tried():
    """Two weak inputs, behind which five stronger ones fail as often, have a common difference."""
    draw = np.random.default_rng(98)
    x = draw.random((8, 4000))
    apart = (x[1] - x[2] > 0.75) & (draw.random(4000) < 0.5)
    assert rules_for(x[1:3].T, apart)[0].conditions[0].minus == "1"
    for strong, tried in ((4, True), (5, False)):
        failed = apart | (x[3 : 3 + strong] < 0.05).any(axis=0)
        differences = {c.minus for rule in rules_for(x.T, failed) for c in rule.conditions}
        assert ("2" in differences) == tried


@pytest.mark.parametrize(("others", "judged"), [(5, True), (4, False)])
def test_rules_need_five_failures_and_five_others_and_ignore_constants(others, judged):
    x = np.column_stack([np.full(400, 3.0), np.random.default_rng(1).permutation(400)])
    few = x[:, 1] < others
    for failed in (few, ~few):
        rules = rules_for(x, failed)
        assert [rule.conditions[0].parameter for rule in rules[:1]] == ["1"] * judged
        assert {rule.failures for rule in rules} <= {failed.sum()}


@pytest.mark.thorough
def test_no_rule_of_any_kind_where_failures_fall_at_random():
    false_alarms = 0
    for seed in range(60):
        inputs = _inputs(seed)
        failed = np.random.default_rng(7400 + seed).random(FLIGHTS) < 0.1
        false_alarms += bool(rules_for(inputs, failed))
    assert false_alarms <= 5


def test_thresholds_of_discrete_inputs_keep_equal_values_together():
    draw = np.random.default_rng(95)
    inputs = np.column_stack([draw.integers(0, 3, 600).astype(float), draw.random(600)])
    failed = inputs[:, 0] == 0.0
    best = rules_for(inputs, failed)[0]
    (condition,) = best.conditions
    assert not condition.above and 0.0 <= condition.threshold < 1.0
    assert (best.failures_inside, best.others_inside) == (best.failures, 0)


@pytest.mark.parametrize("above", [False, True])
def test_an_input_that_is_infinite_in_some_flights_has_rules_but_no_differences(above):
    inputs = _inputs(3)
    inputs[::2, 0] = np.inf  # a failure that never comes
    failed = (np.isinf(inputs[:, 0]) if above else inputs[:, 0] < 0.5) & (
        np.arange(len(inputs)) % 3 > 0
    )
    rules = rules_for(inputs, failed)
    best = rules[0].conditions[0]
    assert best.parameter == "0" and best.above == above and np.isfinite(best.threshold)
    assert all(condition.minus is None for rule in rules for condition in rule.conditions)


def test_ranks_discoveries_and_tails_are_those_of_scipy():
    draw = np.random.default_rng(1)
    values = draw.integers(0, 40, (300, 4)).astype(float)  # with ties
    assert np.array_equal(average_ranks(values), stats.rankdata(values, axis=0))
    assert np.array_equal(average_ranks(values[:, 0]), stats.rankdata(values[:, 0]))
    p_values = draw.uniform(size=200) ** 4
    np.testing.assert_allclose(
        false_discovery(p_values), stats.false_discovery_control(p_values), rtol=1e-14
    )
    for bad, *table in ((3, 1000, 40, 100), (0, 50, 5, 5), (40, 100_000, 60, 9000), (5, 20, 5, 5)):
        assert hypergeometric_tail(bad, *table) == pytest.approx(
            stats.hypergeom.sf(bad - 1, *table), rel=1e-8
        )


@pytest.mark.parametrize(("law", "arguments"), [("uniform", (-0.3, 1.7)), ("norm", (0.2, 3.1))])
def test_plain_distributions_have_the_bits_of_scipy(law, arguments):
    ours, theirs = ContinuousMarginal(law, arguments), getattr(stats, law)(*arguments)
    p = np.concatenate([[0.0, 1.0, 2.0**-53], np.random.default_rng(2).uniform(size=1000)])
    x = np.concatenate([theirs.ppf(p[3:]), [-0.3, 1.4, -9.0, 9.0]])
    assert np.array_equal(ours.ppf(p), theirs.ppf(p))
    assert np.array_equal(ours.cdf(x), theirs.cdf(x)) and np.array_equal(
        ours.density(x), theirs.pdf(x)
    )
    assert ours.frozen.support() == theirs.support()


def test_permutations_of_several_grids_are_counted_as_one_by_one(monkeypatch):
    """The count ends at the tenth exceedance, or after 5000 permutations."""
    draw = np.random.default_rng(4)
    cells, y = draw.integers(0, 4, (3, 24)), draw.standard_normal(24)
    sizes = np.array([np.bincount(own, minlength=4).reshape(2, 2) for own in cells], float)
    at_least = np.array([0.05, 0.4, 1e9])
    expected = []
    for own, size, limit in zip(cells, sizes, at_least, strict=True):
        random, tried, larger = np.random.default_rng(0), 0, 0
        while tried < 5000 and larger < 10:
            sums = np.bincount(own, random.permutation(y), 4).reshape(2, 2)
            means = sums / size
            rows, columns = sums.sum(1) / size.sum(1), sums.sum(0) / size.sum(0)
            between = np.sum(size * (means - rows[:, None] - columns) ** 2)
            larger += between / np.sum(size - sums**2 / size) >= limit
            tried += 1
        expected.append(larger / tried)
    assert 0.0 < expected[1] < expected[0] and expected[2] == 0.0
    for most in (24, 23):  # in blocks, and one by one
        monkeypatch.setattr("abhv_mc.statistics.drivers._BLOCK_FLIGHTS", most)
        np.testing.assert_array_equal(_permute(cells, y, sizes, at_least), expected)
