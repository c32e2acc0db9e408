"""Identification of a linear model, whose estimates have a closed form."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from fake_flight import DENSITY, DRAG
from scipy import stats
from search.known_flights import LINE, METRIC, write_line

from abhv_mc.io.messages import InputError
from abhv_mc.search.identify import identify


def test_estimates_of_vehicles_their_spread_and_the_renewed_campaign(tmp_path):
    """The metric is the lift's normal number, so 0.2 of noise is 0.01 in two flights' lift."""
    path, table = write_line(tmp_path), tmp_path / "flights.csv"
    rows = ["A,0.5", "A,0.7", "B,-1.0", "B,-0.8"]
    table.write_text("\n".join([f"vehicle,{METRIC}", *rows, ""]))
    answer = identify(
        path, [table], noise={METRIC: 0.2}, output=tmp_path / "renewed.yaml", engine=LINE
    )
    (lift,) = answer.parameters
    assert (lift.name, lift.unit) == ("aero.lift", "-")
    assert lift.values == pytest.approx({"A": 1.03, "B": 0.955}, abs=1e-6)
    error = 0.05 * 0.2 / 2**0.5
    assert lift.errors == pytest.approx({"A": error, "B": error}, rel=1e-4)
    spread = (0.075**2 / 2 - error**2) ** 0.5
    numbers = 0.9925, ((spread**2 + error**2) / 2) ** 0.5, spread
    assert (lift.mean, lift.mean_error, lift.spread) == pytest.approx(numbers, rel=1e-3)
    sigma = float(np.hypot(*numbers[1:]))
    renewed = yaml.safe_load((tmp_path / "renewed.yaml").read_text())["dispersions"]
    assert renewed == answer.dispersions and [*renewed] == ["aero.lift", "atmosphere.density"]
    assert renewed["aero.lift"].pop("varies_by") == "vehicle"
    assert float(renewed["aero.lift"]["mean"]) == pytest.approx(0.9925)
    assert float(renewed["aero.lift"]["sigma"]) == pytest.approx(sigma, rel=1e-3)
    assert answer.residuals["flights.csv:2"] == pytest.approx({METRIC: 0.5}, rel=1e-3)
    assert answer.p_value == pytest.approx(stats.chi2.sf(4 * 0.5**2, 2), rel=1e-3)
    assert answer.fits and answer.converged and answer.noise == {METRIC: 0.2}
    assert answer.nuisances == ("atmosphere.density",) and not answer.inseparable
    table.write_text(f"vehicle,{METRIC}\nA,0.5\nA,1.5\n")
    answer = identify(path, [table], ["aero.lift"], noise={METRIC: 0.2}, engine=LINE)
    assert answer.p_value == pytest.approx(stats.chi2.sf(2 * 2.5**2, 1), rel=1e-3)
    assert not answer.fits and answer.parameters[0].spread is None


def test_correlated_nuisances_widen_the_error_by_their_joint_variance(tmp_path):
    """The metric is the sum of normal numbers: of the lift, the density and twice the drag."""

    def fly_sum(plan, parameters, record_every=None):
        block = LINE.fly(plan, parameters, record_every)
        density, drag = parameters[:, [DENSITY]], parameters[:, [DRAG]]
        block.metrics[:] += (density - 1.0) / 0.02 + 2.0 * (drag - 1.0) / 0.1
        return block

    laws = "{aero.lift: {distribution: normal, sigma: 5 %}, atmosphere.density: {distribution: "
    laws += (
        "normal, sigma: 2 %}, aero.drag: {distribution: normal, sigma: 10 %, varies_by: flight}}"
    )
    pairs = "[{between: [atmosphere.density, aero.drag], normal: 0.8}]"
    path, table = write_line(tmp_path, dispersions=laws, correlations=pairs), tmp_path / "f.csv"
    table.write_text(f"vehicle,{METRIC}\nA,1.5\nB,-3\n")
    answer = identify(path, [table], noise={METRIC: 0.5}, engine=replace(LINE, fly=fly_sum))
    (lift,) = answer.parameters
    assert answer.nuisances == ("atmosphere.density", "aero.drag")
    variance = 0.5**2 + 1.0 + 4.0 + 2.0 * 2.0 * 0.8
    assert lift.values == pytest.approx({"A": 1.075, "B": 0.85}, abs=1e-3)
    assert [*lift.errors.values()] == pytest.approx([0.05 * variance**0.5] * 2, rel=1e-3)
    assert {*answer.dispersions} == {"aero.lift", *answer.nuisances}


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"noise": None}, "^--measured: "),
        ({"noise": {"none": 1.0}}, "'none'"),
        ({"parameters": ["aero.drag"]}, r"'aero\.drag'"),
        ({"output": "campaign.yaml"}, "^-o: "),
        ({"output": "other/renewed.yaml"}, "^-o: "),
    ],
)
def test_unknown_errors_names_and_places_are_rejected(tmp_path, options, problem):
    path, table = write_line(tmp_path), tmp_path / "flights.csv"
    table.write_text(f"{METRIC}\n0.5\n")
    if "output" in options:
        options = {"output": tmp_path / options["output"]}
    with pytest.raises(InputError, match=problem):
        identify(path, [table], **{"noise": {METRIC: 0.2}, "engine": LINE, **options})


def test_results_are_printed_with_their_intervals(tmp_path):
    path, table = write_line(tmp_path), tmp_path / "flights.csv"
    table.write_text(f"vehicle,{METRIC}\nA,0.5\nA,0.7\nB,-1.0\n")
    answer = identify(path, [table], noise={METRIC: 0.2}, engine=LINE)

    def numbers(answer):
        texts = [*answer.texts()]
        number = r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?"
        return {label: [*map(float, re.findall(number, text))] for label, text in texts}

    (lift,) = answer.parameters
    printed = numbers(answer)
    three = {"rel": 0.006}
    mean = lift.mean, lift.mean_error, lift.spread
    assert printed["aero.lift (-)"] == pytest.approx(mean, rel=0.05)
    for vehicle in "AB":
        expected = lift.values[vehicle], 1.96 * lift.errors[vehicle], 95.0
        assert printed[f"aero.lift, {vehicle}"] == pytest.approx(expected, rel=0.05)
    assert printed["Noise (sigma)"] == [0.2]
    assert printed["flights.csv:2"] == pytest.approx([0.5, 0.0], **three)
    assert printed["Simulations"] == [answer.simulations] and answer.simulations % 5 == 0
    assert printed["Model fits"] == pytest.approx([answer.p_value, 0.01], rel=0.05)
    assert "Model does not fit" in numbers(replace(answer, fits=False))
    assert "Not converged" in numbers(replace(answer, converged=False))
    lone = replace(answer, parameters=(replace(lift, spread=None),))
    assert len(numbers(lone)["aero.lift (-)"]) == 2
    twins = replace(answer, inseparable=((("a", "b"), -0.987),))
    assert numbers(twins)["Not separable"] == [-0.99]


def test_a_history_identifies_the_parameters_of_each_flight(tmp_path):
    laws = "{atmosphere.density: {distribution: uniform, half_width: 2 %, varies_by: flight}}"
    path, table = write_line(tmp_path, dispersions=laws), tmp_path / "flight.csv"
    times = np.arange(21) / 10
    table.write_text(
        "\n".join(["time,altitude_m", *(f"{t},{1.005 + 0.001 * t}" for t in times), ""])
    )
    answer = identify(path, [table], noise={"altitude_m": 0.01}, engine=LINE)
    (density,) = answer.parameters
    assert density.values == pytest.approx({"flight.csv": 1.006}, abs=1e-6)
    assert density.errors == pytest.approx({"flight.csv": 0.01 / 21**0.5}, rel=1e-3)
    assert answer.dispersions["atmosphere.density"]["varies_by"] == "flight"
    assert answer.offsets == {"flight.csv": 0.0}
