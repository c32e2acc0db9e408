"""The shipped retuned LQRs keep to TLC's control usage on the nominal S and track better than the paper's weights."""

import pytest

from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.outcome import Outcome
from abhv_mc.one_flight.given import make_flight_plan

RETUNED = {
    "ghame_x": "lqr_retuned",
    "ghame_x_coupled": "lqr_retuned_ghame_x_coupled",
    "ghame": "lqr_retuned_ghame",
}


@pytest.fixture(scope="module", params=RETUNED)
def metrics(request: pytest.FixtureRequest) -> dict[str, dict[str, float]]:
    """Metrics of each controller's nominal S with one vehicle."""
    found = {}
    for name, file in {"tlc": "tlc", "lqr": "lqr", "lqr_retuned": RETUNED[request.param]}.items():
        block = fly(make_flight_plan("s_manoeuvre", request.param, file), nominal_parameters())
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
