"""Each distribution of a campaign file against its own law and against what the file says."""

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import stats

from abhv_mc.campaign.sampling.designs import Design
from abhv_mc.campaign.sampling.distributions import Distribution
from abhv_mc.io.documents import Refusal
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.plant.parameters import PARAMETERS

DENSITY = PARAMETERS[PARAMETER_INDEX["atmosphere.density"]]
ALTITUDE = PARAMETERS[PARAMETER_INDEX["initial.altitude"]]
HEADING = PARAMETERS[PARAMETER_INDEX["initial.heading"]]


def make_marginal(parameter, **entry):
    return TypeAdapter(Distribution).validate_python(entry).make_marginal(parameter)


TRUNCATED = stats.truncnorm(-1.2, 1.2, scale=50.0)

# The file's words, and the same law written with scipy by hand.
CASES = [
    (DENSITY, dict(distribution="uniform", half_width="10 %"), stats.uniform(0.9, 0.2)),
    (DENSITY, dict(distribution="uniform", low=0.8, high="130 %"), stats.uniform(0.8, 0.5)),
    (ALTITUDE, dict(distribution="uniform", half_width="0.1 km"), stats.uniform(-100.0, 200.0)),
    (HEADING, dict(distribution="normal", sigma="2 deg"), stats.norm(0.0, np.radians(2.0))),
    (DENSITY, dict(distribution="normal", mean=1.02, sigma="5 %"), stats.norm(1.02, 0.05)),
    (ALTITUDE, dict(distribution="truncated_normal", sigma="50 m", half_width="60 m"), TRUNCATED),
    (DENSITY, dict(distribution="truncated_normal", sigma=0.1, low=0.95, high=1.2), stats.truncnorm(-0.5, 2, 1, 0.1)),
    (DENSITY, dict(distribution="triangular", half_width=0.2), stats.triang(0.5, 0.8, 0.4)),
    (ALTITUDE, dict(distribution="triangular", low="-10 m", high="30 m"), stats.triang(0.25, -10, 40)),
    (DENSITY, dict(distribution="lognormal", sigma="10 %"), stats.lognorm(0.1)),
    (ALTITUDE, dict(distribution="lognormal", sigma=0.5, median="20 m"), stats.lognorm(0.5, scale=20)),
    (DENSITY, dict(distribution="beta", a=2.0, b=3.0, low=0.9, high=1.3), stats.beta(2, 3, 0.9, 0.4)),
    (DENSITY, dict(distribution="scipy", law="weibull_min", shapes={"c": 2.0}, loc=0.5), stats.weibull_min(2.0, 0.5)),
    (ALTITUDE, dict(distribution="scipy", law="gumbel_r", scale="10 m"), stats.gumbel_r(0, 10)),
]  # fmt: skip


@pytest.mark.parametrize("parameter, entry, expected", CASES, ids=lambda case: getattr(case, "name", None))
def test_samples_follow_the_declared_law(parameter, entry, expected):
    law = make_marginal(parameter, **entry)
    values = law.ppf(Design("random", 3, (parameter.name,), 4000).draw(0, 4000)[:, 0])
    assert stats.kstest(values, expected.cdf).pvalue > 1e-3
    np.testing.assert_allclose(law.cdf(values), expected.cdf(values), atol=1e-12)


def test_truncation_is_not_clipping():
    law = make_marginal(DENSITY, distribution="truncated_normal", sigma=0.1, half_width=0.1)
    values = law.ppf(Design("random", 3, ("aero.lift",), 4000).draw(0, 4000)[:, 0])
    assert values.min() > 0.9 and values.max() < 1.1
    assert len(np.unique(values)) == 4000  # clipping would pile flights up at the ends


def test_discrete_choice_has_its_weights():
    law = make_marginal(ALTITUDE, distribution="discrete", values=["5 m", "-1 m", "3 m"], weights=[1.0, 2.0, 5.0])
    values = law.ppf(Design("random", 3, ("aero.lift",), 8000).draw(0, 8000)[:, 0])
    found, counts = np.unique(values, return_counts=True)
    np.testing.assert_array_equal(found, [-1.0, 3.0, 5.0])
    assert stats.chisquare(counts, [2000, 5000, 1000]).pvalue > 1e-3
    np.testing.assert_allclose(law.cdf(np.array([-2.0, -1.0, 4.0, 5.0])), [0.0, 0.25, 0.875, 1.0])


def test_extent_of_bounded_and_unbounded_laws():
    ends = np.array([0.0, 1.0])
    np.testing.assert_allclose(
        make_marginal(DENSITY, distribution="uniform", half_width=0.1).at_fraction(ends), [0.9, 1.1]
    )
    np.testing.assert_allclose(make_marginal(DENSITY, distribution="normal", sigma=0.1).at_fraction(ends), [0.7, 1.3])
    wide = make_marginal(DENSITY, distribution="lognormal", sigma=0.1)  # 0 is where it begins, and no value of it
    np.testing.assert_allclose(wide.at_fraction(ends), np.exp([-0.3, 0.3]))
    discrete = make_marginal(DENSITY, distribution="discrete", values=[0.8, 1.0, 1.1])
    np.testing.assert_array_equal(discrete.at_fraction(np.array([0.0, 0.5, 1.0])), [0.8, 1.0, 1.1])


@pytest.mark.parametrize(
    "parameter, entry, keys",
    [
        (DENSITY, dict(distribution="uniform", half_width="0 %"), ("half_width",)),
        (DENSITY, dict(distribution="uniform", low=1.1, high=0.9), ("high",)),
        (DENSITY, dict(distribution="uniform", half_width=0.1, low=0.9), ()),
        (DENSITY, dict(distribution="normal", sigma=-0.1), ("sigma",)),
        (DENSITY, dict(distribution="truncated_normal", sigma=0.01, low=2.0, high=3.0), ("sigma",)),
        (ALTITUDE, dict(distribution="lognormal", sigma=0.1), ()),
        (DENSITY, dict(distribution="discrete", values=[1.0, 1.0]), ("values",)),
        (DENSITY, dict(distribution="scipy", law="os.system"), ("law",)),
        (DENSITY, dict(distribution="scipy", law="weibull_min", shapes={"c": -1.0}), ()),
    ],
)
def test_what_makes_no_sense_is_refused_where_it_stands(parameter, entry, keys):
    with pytest.raises(Refusal) as caught:
        make_marginal(parameter, **entry)
    assert caught.value.keys == keys
