"""Infeasible campaigns: `validate` rejects them with a location, `run` warns."""

import re

import pytest
from fake_flight import run, write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.feasibility import find_impossible, find_slips
from abhv_mc.check_inputs import check_inputs
from abhv_mc.io.messages import InputErrors

RARE = "[{metric: altitude_error_max_m, below: 50, probability: 0.9999}]"


def ask(metric, side, limit):
    return dict(requirements=f"[{{metric: {metric}, {side}: {limit}, probability: 0.9}}]")


def disperse(law, name="atmosphere.density"):
    return dict(dispersions=f"{{{name}: {{distribution: {law}}}}}")


@pytest.mark.parametrize(
    ("entries", "named"),
    [
        (
            dict(runs="400", requirements=RARE),
            "0.9999 400",
        ),
        (
            dict(
                requirements="[{metric: altitude_error_max_m, below: 50, probability: 0.99}]",
                family="{risk: 0.001}",
            ),
            "0.0005",
        ),
        (ask("altitude_error_max_m", "below", "-50"), "limit -50"),
        (ask("altitude_error_max_m", "above", "-50"), "limit -50"),
        (disperse("uniform, half_width: 12"), "12 %"),
        (disperse("uniform, half_width: 120 %"), "atmosphere.density -0.2"),
        (disperse("uniform, low: 0, high: 2"), "atmosphere.density 0"),
        (disperse("normal, sigma: 40 %"), "atmosphere.density -0.90137"),
        (disperse("discrete, values: [0, 1]"), "atmosphere.density 0"),
    ],
)
def test_what_cannot_come_out_is_found(tmp_path, entries, named):
    """Regression: each of these campaigns was valid, and its flights were useless."""
    (problem,) = find_impossible(read_campaign(write_campaign(tmp_path, **entries)))
    words = re.findall(r"[\w.%-]+", f"{problem.found} {problem.expected}")
    assert set(named.split()) <= set(words) and problem.line


@pytest.mark.parametrize(
    "entries",
    [
        {},
        dict(
            runs="2700",
            requirements="[{metric: altitude_error_max_m, below: 50, probability: 0.999}]",
        ),
        ask("cross_track_error_final_m", "below", "-50"),
        disperse("lognormal, sigma: 50 %"),
        disperse("beta, a: 5, b: 5, low: 0, high: 2"),
        disperse("triangular, low: 0, high: 2"),
        disperse("truncated_normal, sigma: 40 %, half_width: 90 %"),
        disperse("uniform, half_width: 120 %", "aero.rolling_moment.yaw_rate"),
        dict(sampling="sobol", requirements=RARE),  # estimates only
    ],
)
def test_what_can_is_not(tmp_path, entries):
    assert find_impossible(read_campaign(write_campaign(tmp_path, **entries))) == []


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("aero.lift: {d", "aero.drag.elevator: {d", "'aero.drag.elevator'"),
        ("aero.lift: {d", "control.effector_9_effectiveness: {d", "'control.effector_9_eff"),
        ("runs: 2200", "runs: 400", r"\b400\b.* 0\.\d+ "),
    ],
)
def test_validate_refuses_what_the_vehicle_lacks_and_what_cannot_be_shown(
    repository, tmp_path, old, new, named
):
    text = (repository / "campaigns/s_manoeuvre.yaml").read_text().replace("../", f"{repository}/")
    (tmp_path / "c.yaml").write_text(text.replace(old, new))
    with pytest.raises(InputErrors, match=named):
        check_inputs(tmp_path / "c.yaml")


def test_run_warns_flies_and_shows_nothing(tmp_path):
    manifest = run(write_campaign(tmp_path / "f", requirements=RARE), tmp_path / "out").manifest
    assert re.search(r"\b300\b.*\b0\.9999\b", manifest.warnings[0])
    assert manifest.requirements[0].verdict in ("NOT SHOWN", "FAIL")


@pytest.mark.parametrize(
    ("entries", "text"),
    [
        (disperse("uniform, half_width: 0.15 %", "aero.lift"), "1.001 times"),
        (disperse("normal, sigma: 15", "aero.yawing_moment"), "factor 100"),
        (disperse("uniform, low: 0.85 %, high: 1.15 %"), "factor 100"),
        (disperse("uniform, half_width: 80 K", "atmosphere.temperature"), "60 K"),
        (
            dict(requirements="[{metric: altitude_error_max_m, below: 50, probability: 0.9 %}]"),
            "0.9",
        ),
        (disperse("normal, sigma: 15 K", "atmosphere.temperature"), ""),
        (disperse("uniform, half_width: 1 %", "mass.total"), ""),
        (disperse("normal, sigma: 0.1 %", "sensor.speed_scale"), ""),
    ],
)
def test_a_slip_of_a_factor_100_causes_a_warning_with_its_line(tmp_path, entries, text):
    path = write_campaign(tmp_path, **entries)
    found = find_slips(read_campaign(path))
    assert bool(found) == bool(text)
    assert all(re.match(rf"{re.escape(str(path))}:\d+:\d+: .*{text}", slip) for slip in found)
