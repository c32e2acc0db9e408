"""Gust, turbulence, density profile and sensors in flight: each acts as declared, none when it is not."""

import numpy as np
import pytest
from short_flights import cut, rows_of, short_plan

from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.fly import fly
from abhv_mc.flight.plan import FlightPlan


@pytest.fixture(scope="module")
def plan() -> FlightPlan:
    return short_plan(600, mission="level")


def _fly(plan: FlightPlan, *cases: dict[str, float], every: int | None = None):
    return fly(plan, rows_of(*cases), every)


def test_neighbours_do_not_matter(plan: FlightPlan) -> None:
    """Beside turbulence and errors of sensors, each flight is the one that it is alone, bit for bit."""
    rough = {"wind.turbulence": 3.0, "sensor.bank_noise": 0.01, "sensor.altitude_bias": 3.0, "sensor.delay": 0.03}
    more = {"sensor.speed_lag": 0.1, "sensor.mach_noise": 0.1, "sensor.yaw_interval": 0.5, "sensor.altitude_scale": 1.1}
    together = _fly(plan, {}, rough, more)
    for i, case in enumerate(({}, rough, more)):
        assert np.array_equal(_fly(plan, case).metrics[0], together.metrics[i])


def test_turbulence_has_its_rms_from_the_start(plan: FlightPlan) -> None:
    """At the first tick sideslip and angle of attack to the air are the gust over the speed."""
    cases = [{"wind.turbulence": 2.0, "wind.turbulence_seed": (k + 0.5) / 800} for k in range(800)]
    instant = cut(plan, 1)
    block = _fly(instant, {}, *cases, every=1)
    lateral = np.deg2rad(block.history[1:, 0, CHANNEL_INDEX["sideslip_deg"]]) * 1400.0
    alpha = block.history[:, 0, CHANNEL_INDEX["angle_of_attack_deg"]]
    vertical = np.deg2rad(alpha[1:] - alpha[0]) * 1400.0
    assert lateral.std() == pytest.approx(2.0, rel=0.1)
    assert vertical.std() == pytest.approx(2.0, rel=0.1)
    assert abs(np.corrcoef(lateral, vertical)[0, 1]) < 0.12


def test_gust_pushes_the_way_it_blows(plan: FlightPlan) -> None:
    """Flying east with body y to the south: air that moves north makes the sideslip positive."""
    gust = {"wind.gust_north": 20.0, "wind.gust_start": 0.02, "wind.gust_length": 1.0}
    instant = cut(plan, 4)
    block = _fly(instant, {}, gust, every=1)
    beta = block.history[1, :, CHANNEL_INDEX["sideslip_deg"]] - block.history[0, :, CHANNEL_INDEX["sideslip_deg"]]
    assert (beta[:3] == 0.0).all()
    assert np.deg2rad(beta[3]) * 1400.0 == pytest.approx(20.0, rel=0.01)


def test_profile_is_the_density_factor_at_its_knots(plan: FlightPlan) -> None:
    """At 20 km the knot's factor is the factor on the whole density."""
    block = _fly(plan, {"atmosphere.density_at_20km": 1.1}, {"atmosphere.density": 1.1}, every=100)
    q_bar = block.history[:, 0, CHANNEL_INDEX["dynamic_pressure_pa"]]
    assert q_bar[0] == pytest.approx(q_bar[1], rel=1e-6)


def test_delay_reaches_the_controller(plan: FlightPlan) -> None:
    """A short delay changes the commands, not the first of them; one beyond the ring is the longest it holds."""
    block = _fly(plan, {"initial.bank": 0.02}, {"initial.bank": 0.02, "sensor.delay": 0.05}, every=1)
    aileron = block.history[:, :, CHANNEL_INDEX["aileron_command_deg"]]
    assert aileron[0, 0] == aileron[1, 0]
    assert not np.array_equal(aileron[0], aileron[1])
    longest = _fly(plan, {"sensor.delay": 0.25}, {"sensor.delay": 5.0})
    assert np.array_equal(longest.metrics[0], longest.metrics[1])
