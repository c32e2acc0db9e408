"""The shipped retuned LQR keeps to TLC's control usage on the nominal S and tracks better than the paper's weights."""

from pathlib import Path

import pytest

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.mission import read_mission
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.prepare import make_plan
from abhv_mc.flight.signals import METRIC_INDEX
from abhv_mc.plant.vehicles import load_vehicle

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(scope="module")
def metrics() -> dict[str, dict[str, float]]:
    """Metrics of each controller's nominal S."""
    vehicle = load_vehicle(CONFIGS / "vehicle" / "ghame_x.yaml")
    mission = read_mission(CONFIGS / "mission" / "s_manoeuvre.yaml")
    found = {}
    for name in ("tlc", "lqr", "lqr_retuned"):
        controller = read_controller(CONFIGS / "control" / f"{name}.yaml")
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
    for name in ("speed_error_rms_mps", "angle_of_attack_error_rms_deg", "sideslip_rms_deg"):
        assert metrics["lqr_retuned"][name] < 0.5 * metrics["lqr"][name]
