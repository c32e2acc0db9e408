"""A mixture of distributions: its quantiles against scipy's laws and a root finder of scipy's; what it refuses."""

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import optimize, stats

from abhv_mc.campaign.sampling.designs import Design
from abhv_mc.campaign.sampling.distributions import Distribution
from abhv_mc.campaign.sampling.marginals import DiscreteMarginal
from abhv_mc.io.documents import Refusal
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.plant.parameters import PARAMETERS

DENSITY = PARAMETERS[PARAMETER_INDEX["atmosphere.density"]]
NARROW = {"distribution": "normal", "mean": 0.9, "sigma": "5 %"}
WIDE = {"distribution": "normal", "mean": 1.3, "sigma": "1 %"}
CHOICE = {"distribution": "discrete", "values": [0.7, 1.0]}


def make_mixture(*parts, **more):
    entry = {"distribution": "mixture", "parts": list(parts), **more}
    return TypeAdapter(Distribution).validate_python(entry).make_marginal(DENSITY)


def test_two_normals_are_those_of_scipy():
    law = make_mixture(NARROW, WIDE, weights=[3, 1])
    one, other = stats.norm(0.9, 0.05), stats.norm(1.3, 0.01)
    values = np.linspace(0.6, 1.5, 91)
    np.testing.assert_allclose(law.cdf(values), 0.75 * one.cdf(values) + 0.25 * other.cdf(values), atol=1e-15)
    np.testing.assert_allclose(law.density(values), 0.75 * one.pdf(values) + 0.25 * other.pdf(values), rtol=1e-12)
    probabilities = np.array([1e-9, 0.01, 0.3, 0.7499, 0.75, 0.7501, 0.9, 1 - 1e-9])
    expected = [
        optimize.brentq(lambda x, p=p: 0.75 * one.cdf(x) + 0.25 * other.cdf(x) - p, 0.0, 2.0, xtol=1e-15, rtol=1e-15)
        for p in probabilities
    ]
    steep = np.array([0, 1, 2, 3, 6])  # between the two the probability hardly rises: a root finder is lost there
    np.testing.assert_allclose(law.ppf(probabilities)[steep], np.array(expected)[steep], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(law.cdf(law.ppf(probabilities)), probabilities, rtol=0.0, atol=1e-12)


def test_quantiles_are_bracketed_to_1e_12_and_do_not_depend_on_the_others():
    law = make_mixture(NARROW, WIDE, CHOICE)
    probabilities = Design("random", 3, ("aero.lift",), 3000).draw(0, 3000)[:, 0]
    values = law.ppf(probabilities)
    assert np.all(law.cdf(values) >= probabilities)
    assert np.all(law.cdf(values - 1e-12) <= probabilities + 1e-15)
    assert all(law.ppf(probabilities[i : i + 1])[0] == values[i] for i in range(40))
    for atom in (0.7, 1.0):  # exactly, in a sixth of the flights
        assert np.mean(values == atom) == pytest.approx(1 / 6, abs=0.02)
    assert law.density(np.array([0.7, 1.0])) == pytest.approx([1 / 6, 1 / 6])


def test_its_ends_are_those_of_its_parts():
    law = make_mixture(NARROW, WIDE, CHOICE, weights=[1, 1e-6, 1])
    assert law.at_fraction(np.array([0.0, 0.5, 1.0])) == pytest.approx([0.7, 1.015, 1.33], abs=1e-9)


def test_choices_alone_make_a_choice():
    law = make_mixture(CHOICE, {"distribution": "discrete", "values": [1.0, 1.2], "weights": [3, 1]}, weights=[1, 3])
    assert isinstance(law, DiscreteMarginal)
    assert law.values.tolist() == [0.7, 1.0, 1.2]
    assert law.cumulative == pytest.approx([0.125, 0.8125, 1.0])


@pytest.mark.parametrize(
    "parts, more, words",
    [
        ((NARROW, WIDE), {"weights": [1]}, "1 weights"),
        ((NARROW, {**WIDE, "probability": 0.5}), {}, "a part with a probability"),
        ((NARROW, {"distribution": "uniform", "low": 2, "high": 1}), {}, "empty range"),
    ],
)
def test_refused(parts, more, words):
    with pytest.raises(Refusal, match=words) as caught:
        make_mixture(*parts, **more)
    assert caught.value.keys[0] == ("weights" if "weights" in words else "parts")
