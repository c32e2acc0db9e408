"""A dispersion that holds with a probability: the drawn value in that share of the flights, else the nominal one."""

import math
from pathlib import Path

import numpy as np
import pytest
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.distributions import Normal, Uniform
from abhv_mc.io.documents import InputError
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.plant.parameters import PARAMETERS

_LIFT = PARAMETERS[PARAMETER_INDEX["aero.lift"]]
_STUCK = PARAMETERS[PARAMETER_INDEX["failure.elevator.stuck_time"]]
_UNIFORM = np.linspace(0.0005, 0.9995, 1000)


def test_a_failure_comes_in_its_share_of_the_flights_and_never_in_the_others():
    marginal = Uniform(distribution="uniform", low="5 s", high="50 s", probability="5 %").make_marginal(_STUCK)
    values = marginal.ppf(_UNIFORM)
    assert np.sum(np.isfinite(values)) == 50 and np.all(values[50:] == math.inf)
    assert values[:50] == pytest.approx(5.0 + 45.0 * (_UNIFORM[:50] / 0.05))
    assert marginal.cdf(np.array([4.0, 27.5, 1e9, math.inf])) == pytest.approx([0.0, 0.025, 0.05, 1.0])
    assert marginal.density(np.array([20.0, math.inf])) == pytest.approx([0.05 / 45.0, 0.95])
    assert marginal.at_fraction(np.array([0.0, 0.5, 1.0])) == pytest.approx([5.0, 27.5, 50.0])


def test_about_a_nominal_value_the_quantiles_still_rise_and_the_shares_are_right():
    marginal = Normal(distribution="normal", sigma="10 %", probability=0.3).make_marginal(_LIFT)
    values = marginal.ppf(_UNIFORM)
    assert np.all(np.diff(values) >= 0.0)
    assert np.sum(values == 1.0) == pytest.approx(700, abs=1)
    assert np.std(values[values != 1.0]) == pytest.approx(0.1, rel=0.02)
    assert marginal.cdf(values[values != 1.0]) == pytest.approx(_UNIFORM[values != 1.0], abs=1e-9)


def test_a_probability_of_one_is_the_distribution_itself():
    plain, sure = (Uniform(distribution="uniform", half_width="10 %", **more) for more in ({}, {"probability": 1.0}))
    assert np.array_equal(plain.make_marginal(_LIFT).ppf(_UNIFORM), sure.make_marginal(_LIFT).ppf(_UNIFORM))


_ENTRY = "{failure.engine.time: {distribution: uniform, low: 1 s, high: 2 s, probability: 20 %}, aero.lift: \
{distribution: normal, sigma: 5 %}}"


def test_flight_k_has_the_same_failure_however_many_fly(tmp_path: Path):
    few = read_campaign(write_campaign(tmp_path / "a", dispersions=_ENTRY)).make_samples().draw(0, 50)
    many = read_campaign(write_campaign(tmp_path / "b", dispersions=_ENTRY, runs="3000")).make_samples().draw(0, 3000)
    assert np.array_equal(few, many[:50])
    assert np.isfinite(many[:, 0]).mean() == pytest.approx(0.2, abs=0.03)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"sampling": "corners", "runs": "4"}, "a probability with the design 'corners'"),
        ({"correlations": "[{between: [aero.lift, failure.engine.time], rank: 0.5}]"}, "drawn with a probability"),
        ({"dispersions": _ENTRY.replace("20 %", "120 %")}, "120 %"),
        ({"dispersions": "{failure.engine.time: {distribution: normal, sigma: 2 s}}"}, "infinite"),
        ({"dispersions": "{failure.engine.time: {distribution: uniform, half_width: 2 s}}"}, "half_width about inf"),
    ],
)
def test_where_it_has_no_meaning_it_is_refused_with_its_place(tmp_path: Path, entries: dict[str, str], words: str):
    with pytest.raises(InputError, match=words) as error:
        read_campaign(write_campaign(tmp_path / "c", **{"dispersions": _ENTRY} | entries))
    assert ":" in str(error.value)


def test_failures_of_the_vehicles_own_effectors_are_named_after_them(tmp_path: Path):
    entry = "{failure.right_elevon.stuck_time: {distribution: uniform, low: 1 s, high: 2 s}}"
    path = write_campaign(tmp_path / "d", dispersions=entry)
    (tmp_path / "d/vehicle.yaml").write_text("effectors: {left_elevon: {}, right_elevon: {}}\n", encoding="utf-8")
    assert read_campaign(path).names == ("failure.effector_1.stuck_time",)
    (tmp_path / "d/vehicle.yaml").write_text("effectors: {left_elevon: {}}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"parameter 'failure\.right_elevon\.stuck_time'"):
        read_campaign(path)
