"""Distributions of campaign files against scipy, mixtures, and partial probabilities."""

import math

import numpy as np
import pytest
from fake_flight import shipped_configs, write_campaign
from pydantic import TypeAdapter
from scipy import stats

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.designs import Design
from abhv_mc.campaign.sampling.distributions import Distribution
from abhv_mc.campaign.sampling.marginals import DiscreteMarginal
from abhv_mc.io.messages import InputError, Refusal
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.plant.parameters import PARAMETERS

DENSITY = PARAMETERS[PARAMETER_INDEX["atmosphere.density"]]
ALTITUDE = PARAMETERS[PARAMETER_INDEX["initial.altitude"]]
HEADING = PARAMETERS[PARAMETER_INDEX["initial.heading"]]
STUCK = PARAMETERS[PARAMETER_INDEX["failure.elevator.stuck_time"]]
NARROW = {"distribution": "normal", "mean": 0.9, "sigma": "5 %"}
WIDE = {"distribution": "normal", "mean": 1.3, "sigma": "1 %"}
CHOICE = {"distribution": "discrete", "values": [0.7, 1.0]}
ENDS = np.array([0.0, 0.5, 1.0])


def make_marginal(parameter, **entry):
    return TypeAdapter(Distribution).validate_python(entry).make_marginal(parameter)


def make_mixture(*parts, **entries):
    return make_marginal(DENSITY, distribution="mixture", parts=list(parts), **entries)


TRUNCATED = stats.truncnorm(-1.2, 1.2, scale=50.0)

# The file's words, and the same law written with scipy by hand.
CASES = [
    (DENSITY, dict(distribution="uniform", half_width="10 %"), stats.uniform(0.9, 0.2)),
    (DENSITY, dict(distribution="uniform", low=0.8, high="130 %"), stats.uniform(0.8, 0.5)),
    (ALTITUDE, dict(distribution="uniform", half_width="0.1 km"), stats.uniform(-100.0, 200.0)),
    (HEADING, dict(distribution="normal", sigma="2 deg"), stats.norm(0.0, np.radians(2.0))),
    (DENSITY, dict(distribution="normal", mean=1.02, sigma="5 %"), stats.norm(1.02, 0.05)),
    (ALTITUDE, dict(distribution="truncated_normal", sigma="50 m", half_width="60 m"), TRUNCATED),
    (DENSITY, dict(distribution="truncated_normal", sigma=0.1, low=0.95, high=1.2),
        stats.truncnorm(-0.5, 2, 1, 0.1)),
    (DENSITY, dict(distribution="triangular", half_width=0.2), stats.triang(0.5, 0.8, 0.4)),
    (ALTITUDE, dict(distribution="triangular", low="-10 m", high="30 m"),
        stats.triang(0.25, -10, 40)),
    (DENSITY, dict(distribution="lognormal", sigma="10 %"), stats.lognorm(0.1)),
    (ALTITUDE, dict(distribution="lognormal", sigma=0.5, median="20 m"),
        stats.lognorm(0.5, scale=20)),
    (DENSITY, dict(distribution="beta", a=2.0, b=3.0, low=0.9, high=1.3),
        stats.beta(2, 3, 0.9, 0.4)),
    (DENSITY, dict(distribution="scipy", law="weibull_min", shapes={"c": 2.0}, loc=0.5),
        stats.weibull_min(2.0, 0.5)),
    (ALTITUDE, dict(distribution="scipy", law="gumbel_r", scale="10 m"), stats.gumbel_r(0, 10)),
]  # fmt: skip


@pytest.mark.parametrize(
    "parameter, entry, expected", CASES, ids=lambda case: getattr(case, "name", None)
)
def test_samples_follow_the_declared_law(parameter, entry, expected):
    law = make_marginal(parameter, **entry)
    values = law.ppf(Design("random", 3, (parameter.name,), 4000).draw(0, 4000)[:, 0])
    assert stats.kstest(values, expected.cdf).pvalue > 1e-3
    np.testing.assert_allclose(law.cdf(values), expected.cdf(values), atol=1e-12)


def test_discrete_choice_has_its_weights():
    law = make_marginal(
        ALTITUDE, distribution="discrete", values=["5 m", "-1 m", "3 m"], weights=[1.0, 2.0, 5.0]
    )
    values = law.ppf(Design("random", 3, ("aero.lift",), 8000).draw(0, 8000)[:, 0])
    distinct, counts = np.unique(values, return_counts=True)
    np.testing.assert_array_equal(distinct, [-1.0, 3.0, 5.0])
    assert stats.chisquare(counts, [2000, 5000, 1000]).pvalue > 1e-3
    np.testing.assert_allclose(law.cdf(np.array([-2.0, -1.0, 4.0, 5.0])), [0.0, 0.25, 0.875, 1.0])


@pytest.mark.parametrize(
    ("parameter", "entry", "expected"),
    [
        (DENSITY, dict(distribution="uniform", half_width=0.1), [0.9, 1.0, 1.1]),
        (DENSITY, dict(distribution="normal", sigma=0.1), [0.7, 1.0, 1.3]),
        (
            DENSITY,
            dict(distribution="lognormal", sigma=0.1),
            [np.exp(-0.3), np.cosh(0.3), np.exp(0.3)],
        ),  # 0 is no value
        (DENSITY, dict(distribution="discrete", values=[0.8, 1.0, 1.1]), [0.8, 1.0, 1.1]),
        (
            DENSITY,
            dict(distribution="mixture", parts=[NARROW, WIDE, CHOICE], weights=[1, 1e-6, 1]),
            [0.7, 1.015, 1.33],
        ),
        (
            STUCK,
            dict(distribution="uniform", low="5 s", high="50 s", probability="5 %"),
            [5.0, 27.5, 50.0],
        ),
    ],
)
def test_extent_of_bounded_and_unbounded_laws(parameter, entry, expected):
    np.testing.assert_allclose(
        make_marginal(parameter, **entry).at_fraction(ENDS), expected, atol=1e-9
    )


@pytest.mark.parametrize(
    "parameter, entry, keys",
    [
        (DENSITY, dict(distribution="uniform", half_width="0 %"), ("half_width",)),
        (DENSITY, dict(distribution="uniform", low=1.1, high=0.9), ("high",)),
        (DENSITY, dict(distribution="uniform", half_width=0.1, low=0.9), ()),
        (DENSITY, dict(distribution="normal", sigma=-0.1), ("sigma",)),
        (STUCK, dict(distribution="normal", sigma="2 s"), ()),
        (STUCK, dict(distribution="uniform", half_width="2 s"), ("half_width",)),
        (DENSITY, dict(distribution="truncated_normal", sigma=0.01, low=2.0, high=3.0), ("sigma",)),
        (ALTITUDE, dict(distribution="lognormal", sigma=0.1), ()),
        (DENSITY, dict(distribution="discrete", values=[1.0, 1.0]), ("values",)),
        (DENSITY, dict(distribution="scipy", law="os.system"), ("law",)),
        (DENSITY, dict(distribution="scipy", law="weibull_min", shapes={"c": -1.0}), ()),
        (DENSITY, dict(distribution="mixture", parts=[NARROW, WIDE], weights=[1.0]), ("weights",)),
        (
            DENSITY,
            dict(distribution="mixture", parts=[NARROW, {**WIDE, "probability": 0.5}]),
            ("parts", 1),
        ),
        (
            DENSITY,
            dict(
                distribution="mixture", parts=[NARROW, dict(distribution="uniform", low=2, high=1)]
            ),
            ("parts", 1, "high"),
        ),
    ],
)
def test_what_makes_no_sense_is_refused_where_it_stands(parameter, entry, keys):
    with pytest.raises(Refusal) as caught:
        make_marginal(parameter, **entry)
    assert caught.value.keys == keys


def test_two_normals_are_those_of_scipy():
    law = make_mixture(NARROW, WIDE, weights=[3, 1])
    first, second = stats.norm(0.9, 0.05), stats.norm(1.3, 0.01)
    values = np.linspace(0.6, 1.5, 91)
    np.testing.assert_allclose(
        law.cdf(values), 0.75 * first.cdf(values) + 0.25 * second.cdf(values), atol=1e-15
    )
    np.testing.assert_allclose(
        law.density(values), 0.75 * first.pdf(values) + 0.25 * second.pdf(values), rtol=1e-12
    )
    probabilities = np.array([1e-9, 0.01, 0.3, 0.7499, 0.75, 0.7501, 0.9, 1 - 1e-9])
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


def test_choices_alone_make_a_choice():
    law = make_mixture(
        CHOICE,
        {"distribution": "discrete", "values": [1.0, 1.2], "weights": [3, 1]},
        weights=[1, 3],
    )
    assert isinstance(law, DiscreteMarginal)
    assert law.values.tolist() == [0.7, 1.0, 1.2]
    assert law.cumulative == pytest.approx([0.125, 0.8125, 1.0])


_UNIFORM = np.linspace(0.0005, 0.9995, 1000)


def test_a_failure_comes_in_its_share_of_the_flights_and_never_in_the_others():
    marginal = make_marginal(
        STUCK, distribution="uniform", low="5 s", high="50 s", probability="5 %"
    )
    values = marginal.ppf(_UNIFORM)
    assert np.sum(np.isfinite(values)) == 50 and np.all(values[50:] == math.inf)
    assert values[:50] == pytest.approx(5.0 + 45.0 * (_UNIFORM[:50] / 0.05))
    assert marginal.cdf(np.array([4.0, 27.5, 1e9, math.inf])) == pytest.approx(
        [0.0, 0.025, 0.05, 1.0]
    )
    assert marginal.density(np.array([20.0, math.inf])) == pytest.approx([0.05 / 45.0, 0.95])


def test_about_a_nominal_value_the_quantiles_still_rise_and_the_shares_are_right():
    marginal = make_marginal(DENSITY, distribution="normal", sigma="10 %", probability=0.3)
    values = marginal.ppf(_UNIFORM)
    assert np.all(np.diff(values) >= 0.0)
    assert np.sum(values == 1.0) == pytest.approx(700, abs=1)
    assert np.std(values[values != 1.0]) == pytest.approx(0.1, rel=0.02)
    assert marginal.cdf(values[values != 1.0]) == pytest.approx(_UNIFORM[values != 1.0], abs=1e-9)


_ENTRY = (
    "{failure.engine.time: {distribution: uniform, low: 1 s, high: 2 s, probability: 20 %}, "
    "aero.lift: {distribution: normal, sigma: 5 %}}"
)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"sampling": "corners", "runs": "4"}, "probability.*'corners'"),
        (
            {"correlations": "[{between: [aero.lift, failure.engine.time], rank: 0.5}]"},
            "failure.engine.time.* probability",
        ),
        ({"dispersions": _ENTRY.replace("20 %", "120 %")}, "120 %"),
    ],
)
def test_where_it_has_no_meaning_it_is_refused_with_its_place(tmp_path, entries, message):
    with pytest.raises(InputError, match=rf":\d+:\d+: .*{message}"):
        read_campaign(write_campaign(tmp_path / "c", **{"dispersions": _ENTRY} | entries))


def test_failures_of_the_vehicles_own_effectors_are_named_after_them(tmp_path):
    entry = "{failure.right_elevon.stuck_time: {distribution: uniform, low: 1 s, high: 2 s}}"
    unknown = "{control.left_elevon_effectiveness: {low: -10 %, high: 10 %}}"
    cone = str(shipped_configs() / "vehicle/winged_cone.yaml")
    path = write_campaign(tmp_path / "c", vehicle=cone, dispersions=entry, unknowns=unknown)
    assert read_campaign(path).dimensions == (
        "failure.effector_0.stuck_time",
        "control.effector_1_effectiveness",
    )
    path = write_campaign(tmp_path / "d", dispersions=entry)  # a vehicle without effectors
    with pytest.raises(InputError, match=r"parameter 'failure\.right_elevon\.stuck_time'"):
        read_campaign(path)
