"""Limits on loads, heat, bank and oscillation, and the mission's own end: each ends the flight where it says."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.outcome import EndBounds, Outcome
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.io.documents import InputError, read_document, validate
from abhv_mc.kernel.plant.vehicle import LoadBounds
from abhv_mc.one_flight.given import make_flight_plan
from abhv_mc.shipped import shipped_configs
from abhv_mc.simulators.engine import make_engine
from abhv_mc.simulators.make_plans import make_plans
from abhv_mc.vehicle.document import FlightLimits


@pytest.fixture(scope="module")
def plan() -> FlightPlan:
    return make_flight_plan("s_manoeuvre", "ghame_x")


def _limited(plan: FlightPlan, **bounds: float) -> FlightPlan:
    return replace(plan, limits=plan.limits._replace(loads=LoadBounds(**bounds)))


def _ended(plan: FlightPlan):
    block = fly(plan, nominal_parameters(), record_every=1)
    last = round(block.end_time[0] / plan.timing.tick)
    return block, Outcome(int(block.outcome[0])), last


def test_no_limit_changes_no_bit(plan: FlightPlan) -> None:
    free, limited = (fly(p, nominal_parameters()) for p in (plan, _limited(plan, load_factor=1e6, bank=3.2)))
    assert np.array_equal(free.metrics, limited.metrics)


@pytest.mark.parametrize(
    ("name", "outcome", "channel", "scale"),
    [
        ("dynamic_pressure", Outcome.DYNAMIC_PRESSURE_LIMIT, "dynamic_pressure_pa", 1.0),
        ("bank", Outcome.BANK_LIMIT, "bank_deg", math.pi / 180.0),
    ],
)
def test_a_channel_ends_the_flight_at_the_first_tick_beyond(
    plan: FlightPlan, name: str, outcome: Outcome, channel: str, scale: float
) -> None:
    whole = np.abs(fly(plan, nominal_parameters(), 1).history[0, :, CHANNEL_INDEX[channel]].astype(np.float64))
    limit = 0.5 * (whole[0] + whole.max())
    _, ended, last = _ended(_limited(plan, **{name: float(limit * scale)}))
    assert ended is outcome
    assert last == np.argmax(whole > limit) > 0


def test_the_load_factor_ends_it(plan: FlightPlan) -> None:
    block, ended, _ = _ended(_limited(plan, load_factor=1.2))
    assert ended is Outcome.LOAD_FACTOR_LIMIT
    assert 1.2 < block.metrics[0, METRIC_INDEX["load_factor_max_g"]] < 1.25


def test_the_heat_flux_is_sutton_and_graves(plan: FlightPlan) -> None:
    constants = plan.vehicle.constants._replace(nose_radius=0.02)
    nosed = replace(plan, vehicle=plan.vehicle._replace(constants=constants))
    flux = 1.7415e-4 * math.sqrt(0.0880349 / 0.02) * 1400.0**3  # 20 km
    _, above, _ = _ended(_limited(nosed, heat_flux=1.02 * flux))
    _, below, last = _ended(_limited(nosed, heat_flux=0.98 * flux))
    assert (above, below, last) == (Outcome.OK, Outcome.HEAT_FLUX_LIMIT, 0)


def test_an_oscillation_ends_it_where_the_ripple_exceeds_the_limit() -> None:
    lqr = make_flight_plan("s_manoeuvre", "ghame_x", controller="lqr")  # cycles by more than 10 deg of angle of attack
    block, ended, last = _ended(_limited(lqr, angle_of_attack_ripple=math.radians(4.0)))
    assert ended is Outcome.OSCILLATION_LIMIT
    assert 4.0 < block.metrics[0, METRIC_INDEX["angle_of_attack_ripple_deg"]] < 12.0
    assert last > 500  # not before the reference has settled


@pytest.mark.parametrize(
    ("name", "value"),
    [("wind.turbulence", "1 m/s"), ("wind.gust_down", "1 m/s"), ("sensor.bank_noise", "0.1 deg")],
)
def test_an_oscillation_in_gusts_turbulence_or_noise_has_no_limit(name: str, value: str, tmp_path: Path) -> None:
    configs = shipped_configs()
    level = (configs / "mission/level.yaml").read_text(encoding="utf-8")
    (tmp_path / "mission.yaml").write_text(f"{level}\nlimits: {{oscillation: {{sideslip: 5 deg}}}}\n", encoding="utf-8")
    (tmp_path / "campaign.yaml").write_text(
        f"name: swings\nvehicle: {configs}/vehicle/ghame_x.yaml\nmission: mission.yaml\n"
        f"controllers: {{tlc: {configs}/control/tlc.yaml}}\nruns: 9\nseed: 1\nsampling: random\n"
        f"dispersions: {{{name}: {{distribution: uniform, half_width: {value}}}}}\n",
        encoding="utf-8",
    )
    campaign = read_campaign(tmp_path / "campaign.yaml")
    with pytest.raises(InputError, match=rf"campaign.yaml:8.*'{name}' with 'limits: {{oscillation}}'.*still air"):
        make_plans(campaign, ["tlc"], make_engine())


def test_the_files_say_them(tmp_path: Path) -> None:
    path = tmp_path / "limits.yaml"
    path.write_text(
        "angle_of_attack: [-3 deg, 21 deg]\nsideslip: 15 deg\ndynamic_pressure: 95 kPa\nload_factor: 4\n"
        "heat_flux: 1.5 MW/m2\nbank: 80 deg\noscillation: {bank: 5 deg}\n",
        encoding="utf-8",
    )
    bounds = validate(read_document(path), FlightLimits).bounds()
    assert bounds == LoadBounds(95e3, 4.0, 1.5e6, math.radians(80.0), math.radians(5.0))
    path.write_text("angle_of_attack: [-3 deg, 21 deg]\nsideslip: 15 deg\noscillation: 2 deg\n", encoding="utf-8")
    assert validate(read_document(path), FlightLimits).bounds()[4:] == (math.radians(2.0),) * 3
    path.write_text("angle_of_attack: [-3 deg, 21 deg]\nsideslip: 15 deg\nload_factor: 0\n", encoding="utf-8")
    with pytest.raises(InputError):
        validate(read_document(path), FlightLimits)


def test_a_heat_flux_limit_needs_a_nose() -> None:
    with pytest.raises(InputError, match="nose radius"):
        make_flight_plan({"base": "s_manoeuvre", "limits": {"heat_flux": "1 MW/m2"}}, "ghame_x")


def test_a_mission_ends_by_condition_and_has_been_flown() -> None:
    plan = make_flight_plan({"base": "climb", "end": {"altitude_above": "20.5 km"}}, "ghame_x")
    assert plan.limits.end == EndBounds(altitude=(-math.inf, 20500.0))
    block, ended, last = _ended(plan)
    altitude = block.history[0, :, CHANNEL_INDEX["altitude_m"]]
    assert ended is Outcome.OK
    assert altitude[last] > 20500.0 >= altitude[last - 1]
    assert np.isnan(altitude[last + 1 :]).all()


def test_a_limit_outranks_the_end(plan: FlightPlan) -> None:
    both = _limited(plan, load_factor=0.5)
    both = replace(both, limits=both.limits._replace(end=EndBounds(altitude=(-math.inf, 100.0))))
    assert _ended(both)[1] is Outcome.LOAD_FACTOR_LIMIT


def test_it_starts_in_a_bank_in_steady_turning_flight() -> None:
    plan = make_flight_plan({"base": "level", "start.bank": "40 deg"}, "ghame_x")
    block = fly(plan, nominal_parameters(), record_every=1)
    history = block.history[0].astype(np.float64)
    assert history[0, CHANNEL_INDEX["bank_deg"]] == pytest.approx(40.0, abs=1e-5)
    assert history[0, CHANNEL_INDEX["flight_path_angle_deg"]] == pytest.approx(0.0, abs=1e-5)
    assert history[0, CHANNEL_INDEX["sideslip_deg"]] == pytest.approx(0.0, abs=1e-9)
    # Over the first tick nothing but the law's next command disturbs the steady turn.
    turn = np.diff(history[:4, CHANNEL_INDEX["heading_deg"]])[0] / 0.01
    assert turn == pytest.approx(math.degrees(9.7 * math.tan(math.radians(40.0)) / 1400.0), rel=0.05)
    assert abs(np.diff(history[:2, CHANNEL_INDEX["angle_of_attack_deg"]])[0]) < 0.002


def test_it_starts_in_a_climb_and_keeps_it() -> None:
    plan = make_flight_plan({"base": "level", "start.flight_path_angle": "2 deg", "duration": "20 s"}, "ghame_x")
    block = fly(plan, nominal_parameters(), record_every=1)
    height = block.history[0, :, CHANNEL_INDEX["altitude_m"]]
    assert block.history[0, 0, CHANNEL_INDEX["flight_path_angle_deg"]] == pytest.approx(2.0, abs=1e-5)
    assert height[-1] - height[0] == pytest.approx(20.0 * 1400.0 * math.sin(math.radians(2.0)), rel=0.02)
    assert block.metrics[0, METRIC_INDEX["altitude_error_max_m"]] < 10.0
