"""The shipped retuned LQRs keep to TLC's control usage on the nominal S and track better than the paper's weights."""

from pathlib import Path

import pytest

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.mission import read_mission
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.prepare import make_plan
from abhv_mc.user_code.vehicle_functions import load_vehicle

CONFIGS = Path(__file__).parents[3] / "configs"
RETUNED = {
    "ghame_x": "lqr_retuned",
    "ghame_x_coupled": "lqr_retuned_ghame_x_coupled",
    "ghame": "lqr_retuned_ghame",
}


@pytest.fixture(scope="module", params=RETUNED)
def metrics(request: pytest.FixtureRequest) -> dict[str, dict[str, float]]:
    """Metrics of each controller's nominal S with one vehicle."""
    vehicle = load_vehicle(CONFIGS / "vehicle" / f"{request.param}.yaml")
    mission = read_mission(CONFIGS / "mission" / "s_manoeuvre.yaml")
    found = {}
    for name, file in {"tlc": "tlc", "lqr": "lqr", "lqr_retuned": RETUNED[request.param]}.items():
        controller = read_controller(CONFIGS / "control" / f"{file}.yaml")
        block = fly(make_plan(vehicle, mission, controller, name), nominal_parameters())
        assert block.outcome[0] == Outcome.OK
        found[name] = {metric: float(block.metrics[0, i]) for metric, i in METRIC_INDEX.items()}
    return found


@pytest.mark.parametrize("surface", ["aileron", "elevator", "rudder"])
@pytest.mark.parametrize("kind", ["rms", "travel"])
def test_usage_is_at_most_tlcs(metrics: dict[str, dict[str, float]], surface: str, kind: str) -> None:
    name = f"{surface}_{kind}_deg"
    assert metrics["lqr_retuned"][name] <= 1.05 * metrics["tlc"][name]


def test_it_tracks_better_than_the_papers_weights(metrics: dict[str, dict[str, float]]) -> None:
    assert metrics["lqr_retuned"]["sideslip_rms_deg"] < metrics["lqr"]["sideslip_rms_deg"]
    for name in ("speed_error_rms_mps", "angle_of_attack_error_rms_deg"):
        assert metrics["lqr_retuned"][name] < 0.5 * metrics["lqr"][name]
