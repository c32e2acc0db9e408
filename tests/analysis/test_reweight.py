"""Weights of flights for other dispersions."""

import numpy as np
import pytest
from fake_flight import write_campaign
from scipy import stats

from abhv_mc.analysis.reweight import (
    make_change,
    parse_settings,
    unseen_probability,
    weigh_flights,
)
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.messages import InputError


def test_weights_are_the_ratio_of_the_joint_densities(tmp_path):
    """Compare with the bivariate normal density.

    Both distributions are normal, so the copula makes them jointly normal.
    """
    normal = "{distribution: normal, sigma: %s}"
    dispersions = f"{{aero.lift: {normal % 0.05}, aero.drag: {normal % 0.1}}}"
    correlations = "[{between: [aero.drag, aero.lift], normal: 0.5}]"
    campaign = read_campaign(
        write_campaign(tmp_path, dispersions=dispersions, correlations=correlations)
    )
    change = make_change(campaign, {"aero.lift": {"sigma": 0.04, "mean": 1.01}})
    samples = campaign.make_samples().draw(0, 4000)

    def joint(mean, sigma):
        covariance = [[sigma**2, 0.5 * sigma * 0.1], [0.5 * sigma * 0.1, 0.1**2]]
        return stats.multivariate_normal([mean, 1.0], covariance).pdf(samples)

    weights = weigh_flights(campaign, change, samples)
    np.testing.assert_allclose(weights, joint(1.01, 0.04) / joint(1.0, 0.05), rtol=1e-9)
    assert weights.mean() == pytest.approx(1.0, abs=4.0 * weights.std() / np.sqrt(4000))


def test_designs_without_independent_flights_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"\blhs\b"):
        make_change(read_campaign(write_campaign(tmp_path, sampling="lhs")), {})


NORMAL_AND_UNIFORM = (
    "[{distribution: normal, mean: 0.95, sigma: 2 %}, {distribution: uniform, low: 1.0, high: 1.1}]"
)


@pytest.mark.parametrize(("law", "settings", "mean"), [
    ("discrete, values: [0.9, 1.0, "
     "1.1]", ["aero.lift.values=[0.9, 1.1]", "aero.lift.weights=[3, 1]"], 0.95),
    (f"mixture, parts: {NORMAL_AND_UNIFORM}", ["aero.lift.weights=[3, 1]"], 0.975),
])  # fmt: skip
def test_the_mean_is_what_new_weights_of_choices_and_parts_make_of_it(
    tmp_path, law, settings, mean
):
    laws = f"{{aero.lift: {{distribution: {law}}}}}"
    campaign = read_campaign(write_campaign(tmp_path, runs="20000", dispersions=laws))
    samples = campaign.make_samples().draw(0, 20000)
    weights = weigh_flights(campaign, make_change(campaign, parse_settings(settings)), samples)
    assert weights.mean() == pytest.approx(1.0, abs=0.02)
    assert np.average(samples[:, 0], weights=weights) == pytest.approx(mean, abs=0.002)


def test_each_part_of_a_mixture_lies_within_one_that_was_flown(tmp_path):
    parts = (
        "[{distribution: uniform, low: 0.9, high: 0.95}, {distribution: uniform, low: 1.0, "
        "high: 1.1}]"
    )
    laws = f"{{aero.lift: {{distribution: mixture, parts: {parts}}}}}"
    campaign = read_campaign(write_campaign(tmp_path, dispersions=laws))

    def change(parts):
        make_change(campaign, parse_settings([f"aero.lift.parts={parts}"]))

    change(parts.replace("low: 1.0", "low: 1.02"))
    with pytest.raises(InputError, match=r"'aero\.lift' from 0\.9 to 1\.1"):
        change(parts.replace("high: 0.95", "high: 1.1"))
    with pytest.raises(InputError, match="mixture"):
        change(parts.replace("uniform, low: 0.9, high: 0.95", "discrete, values: [0.9, 0.95]"))


def test_the_unseen_probability_is_that_beyond_the_drawn_values(tmp_path):
    """Of a choice, it is the probability of values that were not drawn."""
    laws = "{aero.lift: {distribution: discrete, values: [0.9, 1.0, 1.1]}, aero.drag: "
    laws += "{distribution: uniform, low: 0.8, high: 1.2}}"
    campaign = read_campaign(write_campaign(tmp_path, dispersions=laws))
    change = make_change(campaign, parse_settings(["aero.lift.weights=[1, 1, 2]"]))
    samples = np.column_stack([np.tile([0.9, 1.0], 50), np.linspace(0.8, 1.2, 100)])
    assert unseen_probability(campaign, change, samples).single == pytest.approx(0.5)
    assert weigh_flights(campaign, change, samples) == pytest.approx(np.full(100, 0.75))
