"""Air data, delays, fuel, engine relight, gusts, turbulence and density profiles."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from short_flights import cut, rows_of, short_plan

import abhv_mc
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.mission_tables import DENSITIES, WIND, join_air, read_air_table
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly, fly_until, nominal_parameters
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere, warm_pressure
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan

LEVEL = {"base": "level", "duration": "21 s"}
AIR = {"angle_of_attack": "air", "sideslip": "air"}
WATCHED = [
    *(f"{name}_deg" for name in ("aileron", "rudder", "elevator")),
    "angle_of_attack_deg",
    "sideslip_deg",
]


@pytest.fixture(scope="module")
def plan():
    return short_plan(600, mission="level")


def test_with_air_data_a_uniform_crosswind_is_felt_as_still_air():
    wind = {"wind.north": 20.0}
    calm, air, inertial = (
        abhv_mc.fly({**LEVEL, "sensing": keys}, "ghame_x", dispersions=wind_of, every=100)
        for keys, wind_of in ((AIR, {}), (AIR, wind), ({}, wind))
    )
    off = (air[WATCHED] - calm[WATCHED]).iloc[20].abs()
    assert off.max() < 0.05
    assert (inertial[WATCHED] - calm[WATCHED]).iloc[
        20
    ].abs().max() > 0.5  # the ground's angles hold a sideslip instead
    np.testing.assert_array_equal(
        calm.to_numpy(), abhv_mc.fly(LEVEL, "ghame_x", every=100).to_numpy()
    )


def test_with_a_measured_airspeed_the_airspeed_is_controlled():
    mission = {**LEVEL, "sensing": {"airspeed": "air"}}
    flown = abhv_mc.fly(mission, "ghame_x", dispersions={"wind.east": -5.0}, every=100)
    assert flown["speed_measured_mps"].iloc[0] == pytest.approx(1405.0)
    assert flown["speed_mps"].iloc[-1] < 1399.5


def test_an_empty_tank_ends_a_flight_unless_the_mission_allows_gliding():
    dry = {"base": "ghame_x", "mass.start": "1050 kg", "mass.empty": "1049.5 kg"}
    flights = [
        abhv_mc.fly(LEVEL | {"limits": {"fuel_out": on}}, dry, every=100) for on in (True, False)
    ]
    assert flights[0].attrs["outcome"] == "fuel_out" and 0.1 < flights[0].attrs["end_time_s"] < 5.0
    assert flights[1].attrs["end_time_s"] > 10.0 and (flights[1]["thrust_n"].iloc[6:] == 0.0).all()
    assert any("fuel" in warning for warning in flights[0].attrs["warnings"])


def test_without_an_empty_mass_the_engine_runs_and_the_mass_stays():
    """Regression test: the vehicle flew with its engine off, without a warning."""
    flown = abhv_mc.fly(LEVEL, {"base": "ghame_x", "mass.empty": None}, every=100)
    assert flown.attrs["outcome"] == "ok" and len(set(flown["mass_kg"])) == 1
    metrics = flown.attrs["metrics"]
    assert metrics["fuel_used_kg"] == 0.0 and metrics["equivalence_ratio_min"] > 0.9
    assert metrics["speed_error_max_mps"] < 1.0  # with its engine off it loses 20 m/s a second
    assert any("mass.empty" in warning for warning in flown.attrs["warnings"])


def test_sensor_delays_beyond_the_memory_are_rejected():
    with pytest.raises(InputError, match=r"300 ms.*0 to 250 ms"):
        abhv_mc.fly(LEVEL, "ghame_x", dispersions={"sensor.delay": "300 ms"})
    assert (
        abhv_mc.fly(LEVEL, "ghame_x", dispersions={"sensor.delay": "250 ms"}, every=2000).attrs[
            "end_time_s"
        ]
        > 0.0
    )


def test_a_flame_out_follows_the_engines_lag_and_it_relights_in_its_time():
    failure = {"failure.engine.time": "2 s", "failure.engine.duration": "1 s"}
    relights = {
        "base": "ghame_x",
        "propulsion.relight": {"delay": "0.5 s", "time_constant": "0.2 s"},
    }
    nominal, plain, late = (
        abhv_mc.fly(LEVEL, craft, dispersions=case)["thrust_n"].to_numpy()
        for craft, case in (("ghame_x", {}), ("ghame_x", failure), (relights, failure))
    )
    share = late[:600] / nominal[:600]
    np.testing.assert_allclose(share[:200], 1.0)
    decay = np.exp(-0.1 * np.arange(11))  # 2 zeta / wn = 0.1 s
    np.testing.assert_allclose(
        share[200:210], -np.diff(decay) / 0.1, rtol=0.03
    )  # its mean over each tick
    assert np.abs(np.diff(late[:600])).max() < 0.15 * nominal[0]
    assert share[345] < 1e-3 and share[360] > 0.35  # half a second after the second is over
    assert plain[305] / nominal[305] > 0.3


@pytest.mark.parametrize(
    ("parameter", "ratio"), [("propulsion.thrust", 1.0), ("propulsion.specific_impulse", 1.05)]
)
def test_thrust_is_dispersed_at_the_same_fuel_flow(plan, parameter, ratio):
    """Compare the fuel burned in the first control period.

    The engine has not responded yet, so both flights have the same equivalence ratio.
    """
    states = fly(cut(plan, 1), rows_of({}, {parameter: 1.05}), 1, keep_states=True).states
    nominal, dispersed = states[:, 0, s.MASS] - states[:, 1, s.MASS]
    assert nominal > 0.01  # kg in 10 ms
    assert nominal / dispersed == pytest.approx(ratio, rel=1e-5)


def test_rotary_gusts_have_the_rms_of_their_spectra():
    plan = make_flight_plan({"base": "level", "duration": "60 s"}, "ghame_x", "lqr_robust_ghame_x")
    rows = nominal_parameters(40)
    for name, value in {
        "turbulence": 0.3,
        "turbulence_rotary": 1.0,
        "turbulence_length": 200.0,
    }.items():
        rows[:, PARAMETER_INDEX[f"wind.{name}"]] = value
    rows[:, PARAMETER_INDEX["wind.turbulence_right"]] = 0.5
    rows[:, PARAMETER_INDEX["wind.turbulence_seed"]] = (np.arange(40) + 0.5) / 40
    gusts, saved = [], None
    for tick in range(1000, 6000, 250):
        saved = fly_until(plan, rows, tick, saved)
        gusts.append(saved.rows[:, s.GUST_P : s.GUST_R + 1].copy())
    gusts = np.array(gusts)
    span, sigma, length, speed = plan.vehicle.constants.span, 0.3, 200.0, 1400.0
    omega = np.geomspace(1e-2, 3e4, 200_000)
    lag = lambda b: 1.0 + (b * span * omega / (np.pi * speed)) ** 2  # noqa: E731
    a = length * omega / speed
    vertical = sigma**2 * length / (np.pi * speed) * (1.0 + 3.0 * a**2) / (1.0 + a**2) ** 2
    p = (
        sigma**2
        / (speed * length)
        * 0.8
        * (np.pi * length / (4.0 * span)) ** (1.0 / 3.0)
        / lag(4.0)
    )
    q, r = ((omega / speed) ** 2 * vertical / lag(b) for b in (4.0, 3.0))
    expected = np.sqrt([np.trapezoid(spectrum, omega) for spectrum in (p, q, 0.25 * r)])
    # The tick holds a gust over 14 m: what is faster than that is not there.
    np.testing.assert_allclose(gusts[..., 0].std(), expected[0], rtol=0.06)
    assert (gusts[..., 1:].std(axis=(0, 1)) < 1.05 * expected[1:]).all()


def test_neighbours_do_not_matter(plan):
    """Check that a flight's bits do not depend on turbulence or sensor errors of others."""
    rough = {
        "wind.turbulence": 3.0,
        "sensor.bank_noise": 0.01,
        "sensor.altitude_bias": 3.0,
        "sensor.delay": 0.03,
    }
    sensor_errors = {
        "sensor.speed_lag": 0.1,
        "sensor.mach_noise": 0.1,
        "sensor.yaw_interval": 0.5,
        "sensor.altitude_scale": 1.1,
    }
    together = fly(plan, rows_of({}, rough, sensor_errors))
    for i, case in enumerate(({}, rough, sensor_errors)):
        assert np.array_equal(fly(plan, rows_of(case)).metrics[0], together.metrics[i])


def test_turbulence_has_its_rms_from_the_start(plan):
    """At the first tick sideslip and angle of attack to the air are the gust over the speed."""
    cases = [{"wind.turbulence": 2.0, "wind.turbulence_seed": (k + 0.5) / 800} for k in range(800)]
    block = fly(cut(plan, 1), rows_of({}, *cases), 1)
    lateral = np.deg2rad(block.history[1:, 0, CHANNEL_INDEX["sideslip_deg"]]) * 1400.0
    alpha = block.history[:, 0, CHANNEL_INDEX["angle_of_attack_deg"]]
    vertical = np.deg2rad(alpha[1:] - alpha[0]) * 1400.0
    assert lateral.std() == pytest.approx(2.0, rel=0.1)
    assert vertical.std() == pytest.approx(2.0, rel=0.1)
    assert abs(np.corrcoef(lateral, vertical)[0, 1]) < 0.12


def test_gust_pushes_the_way_it_blows(plan):
    """Flying east with body y to the south: air that moves north makes the sideslip positive."""
    gust = {"wind.gust_north": 20.0, "wind.gust_start": 0.02, "wind.gust_length": 1.0}
    block = fly(cut(plan, 4), rows_of({}, gust), 1)
    beta = (
        block.history[1, :, CHANNEL_INDEX["sideslip_deg"]]
        - block.history[0, :, CHANNEL_INDEX["sideslip_deg"]]
    )
    assert (beta[:3] == 0.0).all()
    assert np.deg2rad(beta[3]) * 1400.0 == pytest.approx(20.0, rel=0.01)


def test_profile_is_the_density_factor_at_its_knots(plan):
    """At 20 km the knot's factor is the factor on the whole density."""
    block = fly(
        plan, rows_of({"atmosphere.density_at_20km": 1.1}, {"atmosphere.density": 1.1}), 100
    )
    q_bar = block.history[:, 0, CHANNEL_INDEX["dynamic_pressure_pa"]]
    assert q_bar[0] == pytest.approx(q_bar[1], rel=1e-6)


def test_a_wind_table_equals_the_wind_parameter(tmp_path):
    (tmp_path / "wind.csv").write_text(
        "altitude_m,wind_north_mps,wind_east_mps\n0,0,5\n40000,40,5\n"
    )
    (tmp_path / "air.csv").write_text("altitude_m,density_factor\n10000,1.03\n30000,1.03\n")
    turn = {"base": "turn", "duration": "15 s"}
    air = {
        "wind": {"file": str(tmp_path / "wind.csv")},
        "density": {"file": str(tmp_path / "air.csv")},
    }
    plan = make_flight_plan({**turn, **air}, "ghame_x")
    block = fly(plan, rows_of({}), 1)
    same = rows_of({"wind.shear_north": 1e-3, "wind.east": 5.0, "atmosphere.density": 1.03})
    still = fly(replace(plan, profile=plan.profile[:0]), same, 1)
    for name in ("altitude_m", "angle_of_attack_deg", "bank_deg", "sideslip_deg"):
        mine, theirs = (b.history[0, :, CHANNEL_INDEX[name]] for b in (block, still))
        assert mine == pytest.approx(theirs, rel=1e-6, abs=1e-6)
    assert abs(block.history[0, 0, CHANNEL_INDEX["sideslip_deg"]]) > 0.5  # 20 m/s across
    # The controllers know the density: the reference has it.
    nominal = make_flight_plan(turn, "ghame_x")
    assert plan.reference[:, 19] == pytest.approx(1.03 * nominal.reference[:, 19])


@pytest.mark.parametrize("name", ["temperature", "uniform_temperature_offset"])
def test_warmer_air_changes_density_and_mach_number(tmp_path, name):
    offsets, gas = np.array([0.0, 12.0, -20.0]), 287.05287
    table = tmp_path / "air.csv"
    levels = "".join(f"{z},{atmosphere(1e3 * z)[1] / 100.0},{210 + z / 2}\n" for z in range(15, 26))
    table.write_text("altitude_km,pressure_hPa,temperature [K]\n" + levels)
    warmed = {"base": "level", "density": {"file": str(table)}}
    for mission, usual in (("level", 216.65), (warmed, 220.0)):
        plan = cut(make_flight_plan(mission, "ghame_x", "tlc"), 3)
        rows = rows_of(*({f"atmosphere.{name}": offset} for offset in offsets))
        rows_end = fly_until(plan, rows, 3).rows
        altitude, speed = rows_end[:, s.X + s.ALTITUDE], rows_end[:, s.AIRSPEED]
        kelvin = usual + offsets
        sound = np.sqrt(1.4 * gas * kelvin)
        pressure = np.array([atmosphere(height)[1] for height in altitude])
        if name != "temperature":  # the weight of a column with an equal pressure at sea level
            heights = np.linspace(0.0, 19937.0, 20001)  # geopotential
            standard = np.interp(heights, [0.0, 11e3, 20e3], [288.15, 216.65, 216.65])
            change = 1.0 / standard - 1.0 / (standard + offsets[:, None])
            pressure *= np.exp(9.80665 / gas * np.trapezoid(change, heights))
        # The profile is held over a tick, and the pressure of the last stage is that of its own
        # altitude.
        assert rows_end[:, s.RHO] == pytest.approx(pressure / (gas * kelvin), rel=2e-5)
        assert rows_end[:, s.V_MACH] == pytest.approx(speed / sound, rel=2e-5)
        nominal_sound = plan.reference[0, REFERENCE.index("sound_speed")]
        assert nominal_sound == pytest.approx(np.sqrt(1.4 * gas * usual), rel=1e-5)
        # The trim tables apply at the speed of sound of the table.
        trimmed = abhv_mc.trim("ghame_x", mission=mission).equivalence_ratio[0]
        assert plan.reference[0, ref.EQUIVALENCE_RATIO] == pytest.approx(trimmed, rel=2e-3)


def test_20_k_more_in_a_column_are_denser_air_at_20_km():
    assert warm_pressure(20e3, 20.0) * 216.65 / 236.65 == pytest.approx(1.153, abs=1e-3)
    # below the sea, in each layer, and above the last
    for altitude in (-1e3, 5e3, 15e3, 25e3, 40e3, 49e3, 60e3, 75e3, 88e3):
        assert warm_pressure(altitude, 0.0) == 1.0
        pressure, temperature = atmosphere(altitude)[1:3]
        above = [
            atmosphere(altitude + rise)[1] * warm_pressure(altitude + rise, 9.0)
            for rise in (-5.0, 5.0)
        ]
        gravity = 9.80665 * (6356766.0 / (6356766.0 + altitude)) ** 2
        density = pressure * warm_pressure(altitude, 9.0) / (287.05287 * (temperature + 9.0))
        assert (above[0] - above[1]) / 10.0 == pytest.approx(gravity * density, rel=1e-5)


LEVELS = np.arange(0.0, 41e3, 500.0)


def write_ensemble(folder, members, weights=None):
    """Write members, each with the arrays wind_north, wind_east, pressure and temperature."""
    columns = ("altitude_m", "wind_north_mps", "wind_east_mps", "pressure_Pa", "temperature_K")
    tables = []
    for number, member in enumerate(members):
        table = pd.DataFrame(dict(zip(columns, (LEVELS[number:], *member), strict=True)))
        table.insert(0, "member", f"era5-{number}")
        if weights is not None:
            table["weight"] = weights[number]
        tables.append(table)
    pd.concat(tables).to_parquet(folder / "members.parquet", index=False)
    return [table.drop(columns="member") for table in tables]


def draw_air(seed, levels):
    draw = np.random.default_rng(seed)
    standard = np.array([atmosphere(z) for z in levels.tolist()])
    winds = 20.0 * draw.standard_normal((2, len(levels)))
    return (*winds, standard[:, 1] * 1.02, standard[:, 2] + 5.0 * draw.standard_normal(len(levels)))


def test_a_member_is_its_own_table_to_the_bit(tmp_path):
    tables = write_ensemble(tmp_path, [draw_air(i, LEVELS[i:]) for i in range(3)])
    base = {"base": "turn", "duration": "2 s"}
    ensemble = {"atmosphere": {"ensemble": str(tmp_path / "members.parquet")}}
    plan = make_flight_plan({**base, **ensemble}, "ghame_x")
    assert plan.members == 3
    block = fly(plan, rows_of(*({"atmosphere.member": k} for k in (0, 3, 1, 2))), 1)
    for row, k in enumerate((3, 1, 2), 1):
        tables[k - 1].to_csv(tmp_path / f"{k}.csv", index=False)
        air = (
            read_air_table(tmp_path / f"{k}.csv", WIND, {}),
            read_air_table(tmp_path / f"{k}.csv", DENSITIES, {}),
        )
        own = fly(replace(plan, profile=join_air(*air)), rows_of({}), 1)
        assert np.array_equal(block.history[row], own.history[0], equal_nan=True)
    calm = fly(make_flight_plan(base, "ghame_x"), rows_of({}), 1)
    assert np.array_equal(block.history[0], calm.history[0], equal_nan=True)
    assert np.array_equal(block.metrics[0], calm.metrics[0], equal_nan=True)


@pytest.mark.parametrize(
    ("name", "fragment"), [("atmosphere.member", "0 to 3"), ("member", "'atmosphere.member'")]
)
def test_a_member_that_does_not_exist_is_rejected(tmp_path, name, fragment):
    write_ensemble(tmp_path, [draw_air(i, LEVELS[i:]) for i in range(3)])
    mission = {"base": "level", "atmosphere": {"ensemble": str(tmp_path / "members.parquet")}}
    with pytest.raises(InputError, match=fragment):
        abhv_mc.fly(mission, "ghame_x", dispersions={name: 4})
