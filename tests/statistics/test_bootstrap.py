import numpy as np
import pytest

from abhv_mc.statistics.bootstrap import PairedBootstrap, quantile_differences, replicates_for

PROBABILITIES = (0.0, 0.5, 0.95, 0.9973, 1.0)


def test_resampled_quantiles_are_numpys():
    draw = np.random.default_rng(3)
    values = draw.normal(size=101).round(1)  # with ties
    resamples = PairedBootstrap(101, 50)
    found = resamples.quantiles(values, PROBABILITIES)
    for row, counts in zip(found, resamples.counts, strict=True):
        assert row == pytest.approx(np.quantile(np.repeat(values, counts), PROBABILITIES), rel=1e-12)


def test_same_seed_same_interval():
    draw = np.random.default_rng(4)
    a, b = draw.normal(size=200), draw.normal(size=200)
    first = quantile_differences(a, b, (0.5,), PairedBootstrap(200))
    assert first == quantile_differences(a, b, (0.5,), PairedBootstrap(200))


def test_intervals_cover_a_known_difference():
    draw = np.random.default_rng(5)
    resamples = PairedBootstrap(150, 300)
    inside = 0
    for _ in range(200):
        common = draw.normal(size=150)
        a, b = common + draw.normal(size=150), 2.0 + common + draw.normal(size=150)
        (found,) = quantile_differences(a, b, (0.5,), resamples)
        inside += found.low <= -2.0 <= found.high
    assert inside >= 180  # 95 % less three standard errors


def test_pairing_narrows_the_interval():
    draw = np.random.default_rng(6)
    common = draw.normal(0.0, 10.0, 400)
    a, b = common + draw.normal(size=400), common + draw.normal(size=400)
    (paired,) = quantile_differences(a, b, (0.5,), PairedBootstrap(400))
    (shuffled,) = quantile_differences(a, draw.permutation(b), (0.5,), PairedBootstrap(400))
    assert paired.high - paired.low < 0.4 * (shuffled.high - shuffled.low)


def test_a_quantile_that_neither_reaches_has_no_difference():
    values = np.where(np.arange(100) < 20, np.inf, np.arange(100.0))
    median, high = quantile_differences(values, values[::-1], (0.5, 0.95), PairedBootstrap(100))
    assert np.isfinite([median.value, median.low, median.high]).all()
    assert np.isnan([high.value, high.low, high.high]).all()


def test_replicates_fall_with_size():
    assert replicates_for(1000) == 1000
    assert replicates_for(100_000) == 200
    with pytest.raises(ValueError, match="at least one"):
        PairedBootstrap(0)
