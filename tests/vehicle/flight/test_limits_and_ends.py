"""Tests of the limits on loads, heat, bank and oscillation, and of the mission's end.

Each ends the flight at the expected time.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.flight.plan import EndBounds
from abhv_mc_vehicle.kernel.plant.vehicle import LoadBounds
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan, write_inputs


@pytest.fixture(scope="module")
def plan():
    return make_flight_plan("s_manoeuvre", "ghame_x")


def _limited(plan, **bounds):
    return replace(plan, limits=plan.limits._replace(loads=LoadBounds(**bounds)))


def _ended(plan):
    block = fly(plan, nominal_parameters(), record_every=1)
    last = round(block.end_time[0] / plan.timing.tick)
    return block, Outcome(int(block.outcome[0])), last


@pytest.mark.parametrize(
    ("limits", "outcome", "warned"),
    [
        ({"limits.mach": [4.8, 6.0]}, Outcome.MACH_LIMIT, "mach"),
        ({"limits.altitude": ["18 km", "19.99 km"]}, Outcome.ALTITUDE_LIMIT, "altitude"),
        ({"limits.altitude": ["18 km", "24 km"], "limits.mach": [4, 6]}, Outcome.OK, ""),
        ({"surfaces.limits": {"rudder": "0.3 deg"}}, Outcome.OK, ""),
    ],
)
def test_a_vehicle_limits_altitude_mach_and_single_surfaces(limits, outcome, warned):
    plan = make_flight_plan("turn", {"base": "ghame_x", **limits})
    block, ended, _ = _ended(plan)
    assert ended == outcome
    assert any(warned in text for text in plan.warnings) if warned else not plan.warnings.size
    metrics = dict(zip(METRIC_INDEX, block.metrics[0], strict=False))
    limited = "surfaces.limits" in limits
    assert (metrics["surface_saturation_s"] > 0.0) == limited
    assert (metrics["rudder_max_deg"] <= 0.3) == limited or ended != Outcome.OK


@pytest.mark.parametrize(
    ("name", "outcome", "channel", "scale"),
    [
        ("dynamic_pressure", Outcome.DYNAMIC_PRESSURE_LIMIT, "dynamic_pressure_pa", 1.0),
        ("load_factor", Outcome.LOAD_FACTOR_LIMIT, "load_factor_g", 1.0),
        ("bank", Outcome.BANK_LIMIT, "bank_deg", math.pi / 180.0),
    ],
)
def test_a_channel_ends_the_flight_at_the_first_tick_beyond(plan, name, outcome, channel, scale):
    size = np.abs(
        fly(plan, nominal_parameters(), 1).history[0, :, CHANNEL_INDEX[channel]].astype(np.float64)
    )
    limit = 0.5 * (size[0] + size.max())
    _, ended, last = _ended(_limited(plan, **{name: float(limit * scale)}))
    assert ended is outcome
    assert last == np.argmax(size > limit) > 0


def test_the_heat_flux_is_sutton_and_graves(plan):
    constants = plan.vehicle.constants._replace(nose_radius=0.02)
    nosed = replace(plan, vehicle=plan.vehicle._replace(constants=constants))
    flux = 1.7415e-4 * math.sqrt(0.0880349 / 0.02) * 1400.0**3  # 20 km
    _, above, _ = _ended(_limited(nosed, heat_flux=1.02 * flux))
    _, below, last = _ended(_limited(nosed, heat_flux=0.98 * flux))
    assert (above, below, last) == (Outcome.OK, Outcome.HEAT_FLUX_LIMIT, 0)


def test_an_oscillation_ends_it_where_the_ripple_exceeds_the_limit():
    lqr = make_flight_plan(
        "s_manoeuvre", "ghame_x", controller="lqr"
    )  # cycles by more than 10 deg of angle of attack
    block, ended, last = _ended(_limited(lqr, angle_of_attack_ripple=math.radians(4.0)))
    assert ended is Outcome.OSCILLATION_LIMIT
    assert 4.0 < block.metrics[0, METRIC_INDEX["angle_of_attack_ripple_deg"]] < 12.0
    assert last > 500  # not before the reference has settled


@pytest.mark.parametrize(
    ("name", "value"),
    [("wind.turbulence", "1 m/s"), ("wind.gust_down", "1 m/s"), ("sensor.bank_noise", "0.1 deg")],
)
def test_an_oscillation_in_gusts_turbulence_or_noise_has_no_limit(name, value, tmp_path):
    mission = {"base": "level", "limits": {"oscillation": {"sideslip": "5 deg"}}}
    content = {
        "name": "swings",
        "vehicle": "ghame_x",
        "mission": mission,
        "controllers": "tlc",
        "runs": 9,
    }
    dispersions = {name: {"distribution": "uniform", "half_width": value}}
    campaign = read_campaign(write_inputs(content | {"dispersions": dispersions}, tmp_path))
    with pytest.raises(
        InputError,
        match=rf"campaign.yaml:\d.*'{name}' conflicts with 'limits: {{oscillation}}'.*still air",
    ):
        campaign.simulator.make_plans(["tlc"])


def _loads(vehicle, mission):
    changes = {f"limits.{name}": value for name, value in vehicle.items()}
    return make_flight_plan(
        {"base": "level", "limits": mission}, {"base": "ghame_x", **changes}
    ).limits.loads


def test_the_tighter_limit_of_vehicle_and_mission_holds():
    vehicle = {"dynamic_pressure": "95 kPa", "load_factor": 4, "oscillation": "2 deg"}
    loads = _loads(vehicle, {"load_factor": 5, "bank": "80 deg", "oscillation": {"bank": "1 deg"}})
    assert loads == LoadBounds(95e3, 4.0, math.inf, *np.radians([80.0, 1.0, 2.0, 2.0]).tolist())
    for limits, pattern in (
        ({"heat_flux": "1 MW/m2"}, "nose radius"),
        ({"load_factor": 0}, "greater than 0"),
    ):
        with pytest.raises(InputError, match=pattern):
            _loads({}, limits)


def test_the_speed_is_limited_by_the_mission_or_to_twice_its_reference(plan):
    assert plan.limits.speed_max == pytest.approx(2.0 * 1400.0)
    mission = {"base": "s_manoeuvre", "limits": {"speed": "1.45 km/s"}}
    assert make_flight_plan(mission, "ghame_x").limits.speed_max == 1450.0
    speed = fly(plan, nominal_parameters(), 1).history[0, :, CHANNEL_INDEX["speed_mps"]]
    limit = 0.5 * (float(speed[0]) + float(speed.max()))
    _, outcome, last = _ended(replace(plan, limits=plan.limits._replace(speed_max=limit)))
    assert outcome is Outcome.SPEED_LIMIT
    assert last == np.flatnonzero(speed > limit)[0]


def test_a_mission_ends_by_condition_and_has_been_flown():
    plan = make_flight_plan({"base": "climb", "end": {"altitude_above": "20.5 km"}}, "ghame_x")
    assert plan.limits.end == EndBounds(altitude=(-math.inf, 20500.0))
    block, ended, last = _ended(plan)
    altitude = block.history[0, :, CHANNEL_INDEX["altitude_m"]]
    assert ended is Outcome.OK
    assert altitude[last] > 20500.0 >= altitude[last - 1]
    assert np.isnan(altitude[last + 1 :]).all()


def test_a_limit_outranks_the_end(plan):
    both = _limited(plan, load_factor=0.5)
    both = replace(both, limits=both.limits._replace(end=EndBounds(altitude=(-math.inf, 100.0))))
    assert _ended(both)[1] is Outcome.LOAD_FACTOR_LIMIT


def test_it_starts_in_a_bank_in_steady_turning_flight():
    plan = make_flight_plan({"base": "level", "start.bank": "40 deg"}, "ghame_x")
    block = fly(plan, nominal_parameters(), record_every=1)
    history = block.history[0].astype(np.float64)
    assert history[0, CHANNEL_INDEX["bank_deg"]] == pytest.approx(40.0, abs=1e-5)
    assert history[0, CHANNEL_INDEX["flight_path_angle_deg"]] == pytest.approx(0.0, abs=1e-5)
    assert history[0, CHANNEL_INDEX["sideslip_deg"]] == pytest.approx(0.0, abs=1e-9)
    # Over the first tick nothing but the law's next command disturbs the steady turn.
    turn = np.diff(history[:4, CHANNEL_INDEX["heading_deg"]])[0] / 0.01
    assert turn == pytest.approx(
        math.degrees(9.7 * math.tan(math.radians(40.0)) / 1400.0), rel=0.05
    )
    assert abs(np.diff(history[:2, CHANNEL_INDEX["angle_of_attack_deg"]])[0]) < 0.002


def test_it_starts_in_a_climb_and_keeps_it():
    plan = make_flight_plan(
        {"base": "level", "start.flight_path_angle": "2 deg", "duration": "20 s"}, "ghame_x"
    )
    block = fly(plan, nominal_parameters(), record_every=1)
    height = block.history[0, :, CHANNEL_INDEX["altitude_m"]]
    assert block.history[0, 0, CHANNEL_INDEX["flight_path_angle_deg"]] == pytest.approx(
        2.0, abs=1e-5
    )
    assert height[-1] - height[0] == pytest.approx(
        20.0 * 1400.0 * math.sin(math.radians(2.0)), rel=0.02
    )
    assert block.metrics[0, METRIC_INDEX["altitude_error_max_m"]] < 10.0
