"""Infeasible campaigns: `validate` rejects them with a location, `run` warns."""

import pytest
from fake_flight import run, write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.feasibility import find_impossible
from abhv_mc.check_inputs import check_inputs
from abhv_mc.io.documents import InputErrors

RARE = "[{metric: altitude_error_max_m, below: 50, probability: 0.9999}]"


def ask(metric, side, limit):
    return dict(requirements=f"[{{metric: {metric}, {side}: {limit}, probability: 0.9}}]")


def disperse(law, name="atmosphere.density"):
    return dict(dispersions=f"{{{name}: {{distribution: {law}}}}}")


@pytest.mark.parametrize(
    ("entries", "messages"),
    [
        (
            dict(runs="400", requirements=RARE),
            "0.9999 that 400 flights cannot demonstrate|at least 26",
        ),
        (
            dict(
                requirements="[{metric: altitude_error_max_m, below: 50, probability: 0.99}]",
                family="{risk: 0.001}",
            ),
            "demonstrate at a risk of 0.0005",
        ),
        (ask("altitude_error_max_m", "below", "-50"), "below -50, which no flight meets"),
        (ask("altitude_error_max_m", "above", "-50"), "above -50, which every flight meets"),
        (disperse("uniform, half_width: 12"), "did you mean '12 %' in place of 12?"),
        (disperse("uniform, half_width: 120 %"), "'atmosphere.density' down to -0.2"),
        (disperse("uniform, low: 0, high: 2"), "down to 0"),
        (disperse("normal, sigma: 40 %"), "down to -0.9"),
        (disperse("discrete, values: [0, 1]"), "down to 0"),
    ],
)
def test_what_cannot_come_out_is_found(tmp_path, entries, messages):
    """Regression: each of these campaigns was valid, and its flights were useless."""
    (problem,) = find_impossible(read_campaign(write_campaign(tmp_path, **entries)))
    assert any(message in str(problem) for message in messages.split("|")) and problem.line


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


LIFT = "aero.lift: {distribution"
ABSENT = "refers to a component that the vehicle does not have"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (LIFT, LIFT.replace("aero.lift", "aero.drag.elevator"), f"'aero.drag.elevator' {ABSENT}"),
        (LIFT, LIFT.replace("aero.lift", "control.effector_9_effectiveness"), ABSENT),
        ("runs: 2200", "runs: 400", "that 400 flights cannot demonstrate"),
    ],
)
def test_validate_refuses_what_the_vehicle_lacks_and_what_cannot_be_shown(
    repository, tmp_path, old, new, message
):
    text = (repository / "campaigns/s_manoeuvre.yaml").read_text().replace("../", f"{repository}/")
    (tmp_path / "c.yaml").write_text(text.replace(old, new))
    with pytest.raises(InputErrors, match=message):
        check_inputs(tmp_path / "c.yaml")


def test_run_warns_flies_and_shows_nothing(tmp_path):
    manifest = run(write_campaign(tmp_path / "f", requirements=RARE), tmp_path / "out").manifest
    assert manifest.warnings[0].startswith(
        "the campaign has a probability of 0.9999 that 300 flights cannot"
    )
    assert manifest.requirements[0].verdict in ("NOT SHOWN", "FAIL")
