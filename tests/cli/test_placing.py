"""Tests of the commands compare and identify for test flights of a custom simulator."""

import json
from dataclasses import replace

import pytest
from own_simulators import glide_campaign, write_glide
from programs import invoke

from abhv_mc.api import Campaign
from abhv_mc.io.messages import InputError


def test_flights_that_do_not_fit_are_identified_and_then_fit(tmp_path):
    path = glide_campaign(tmp_path)
    flights = [(1.3, 1.0, "A", 0.0), (1.3, 1.0, "A", 2.3), (1.2, 0.95, "B", 0.0)]
    table = write_glide(tmp_path, flights)
    placed = json.loads(invoke("compare", table, path, "--json", "-").stdout)
    assert placed["together_p_value"] <= 0.05 and placed["vehicles"] == 2
    assert placed["by_vehicle"] == ["drag", "lift"]
    offsets = [flight["offset_s"] for flight in placed["flights"]]
    assert offsets == pytest.approx([0.0, 2.3, 0.0], abs=0.4)
    result = invoke("identify", table, path, "-o", tmp_path / "renewed.yaml")
    assert result.exit_code == 0 and "Model fits" in result.stdout, result.output
    answer = Campaign.read(path).identify([table])
    numbers = json.loads(invoke("identify", table, path, "--json", "-").stdout)
    assert numbers["parameters"][0]["values"] == answer.parameters[0].values
    drag, lift = answer.parameters
    for own, truth in ((drag, (1.3, 1.2)), (lift, (1.0, 0.95))):
        for value, error, true in zip(own.values.values(), own.errors.values(), truth, strict=True):
            assert abs(value - true) < 3.0 * error < 0.1
    assert answer.nuisances == ("wind",) and answer.fits and answer.converged
    stopped = [*replace(answer, fits=False, converged=False).texts()]
    assert "Not converged" in str(stopped) and "fits" not in str(stopped)
    renewed = Campaign.read(tmp_path / "renewed.yaml")
    assert renewed.parameters == ("drag", "lift", "wind")
    assert (tmp_path / "renewed.yaml").read_text("utf-8").startswith("# Dispersions identified")
    result = invoke("compare", table, tmp_path / "renewed.yaml", "-o", tmp_path / "page")
    assert "Not covered  " not in result.stdout and "All test flights" in result.stdout
    assert (tmp_path / "page/figures/placement.png").is_file()


def test_a_model_that_does_not_fit_is_said_not_to_fit(tmp_path):
    path = glide_campaign(tmp_path)
    table = write_glide(tmp_path, [(1.0, 1.0, "A", 0.0)], ripple=0.4)
    result = invoke("identify", table, path, "--parameters", "drag")
    assert result.exit_code == 1 and "Model does not fit" in result.stdout


@pytest.mark.parametrize(
    ("command", "options", "problem"),
    [
        ("compare", ("--measured", "alpha=-1"), "-1"),
        ("compare", ("--measured", "beta=1"), "'beta'"),
        ("compare", ("--fail-if-worse", "total=5%"), "only for two campaigns"),
        ("identify", ("--parameters", "mass"), "'mass'"),
        ("identify", ("-o", "elsewhere.yaml"), "elsewhere.yaml"),
    ],
)
def test_invalid_options_are_rejected(tmp_path, command, options, problem):
    path = glide_campaign(tmp_path)
    table = write_glide(tmp_path, [(1.0, 1.0, "A", 0.0)])
    error = invoke(command, table, path, *options).exception
    assert isinstance(error, InputError) and problem in str(error)


def test_metrics_need_the_errors_of_their_measurements(tmp_path):
    path = glide_campaign(tmp_path)
    (tmp_path / "rows.csv").write_text("total\n260\n", encoding="utf-8")
    error = invoke("identify", tmp_path / "rows.csv", path).exception
    assert isinstance(error, InputError) and "--measured total=SIGMA" in str(error)
