"""Flights, trims, campaigns, margins and linear models from Python without files."""

import math
import re

import control
import numpy as np
import pandas as pd
import pytest
from golden import compare_report

import abhv_mc
from abhv_mc.io.messages import InputError
from abhv_mc.topics.comparison.figures import draw
from abhv_mc_vehicle.flight.channels import CHANNELS
from abhv_mc_vehicle.flight.metrics import METRICS
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.one_flight.linear_models import take_point


def test_a_flight_is_a_table_with_units_and_metrics():
    table = abhv_mc.fly("level", every=10)
    assert list(table.columns) == ["time", *(channel.name for channel in CHANNELS)]
    assert table.attrs["units"] == {"time": "s"} | {
        channel.name: channel.unit for channel in CHANNELS
    }
    assert table.time.iloc[-1] == 60.0 and table.attrs["outcome"] == "ok"
    assert set(table.attrs["metrics"]) == {metric.name for metric in METRICS}


def test_dispersions_and_overrides_change_the_flight_as_their_files_would():
    nominal = abhv_mc.fly("level", every=100)
    draggy = abhv_mc.fly("level", dispersions={"aero.drag": "110 %"}, every=100)
    same = abhv_mc.fly(
        {"base": "level", "duration": "60 s"}, {"base": "abhv"}, {"base": "tlc"}, {}, every=100
    )
    pd.testing.assert_frame_equal(nominal, same)
    assert draggy.attrs["metrics"]["fuel_used_kg"] > 1.05 * nominal.attrs["metrics"]["fuel_used_kg"]
    heavy = abhv_mc.fly("level", {"base": "ghame_x", "mass.start": "1450 kg"}, every=100)
    assert heavy.mass_kg.iloc[0] == pytest.approx(1450.0)
    short = abhv_mc.fly(
        {"base": "level", "duration": "5 s"}, dispersions={"failure.engine.time": 1.0}
    )
    assert len(short) == 501 and short.attrs["metrics"]["engine_failed_s"] == pytest.approx(
        4.01
    )  # both ends count


def test_a_dispersion_that_the_vehicle_does_not_feel_is_refused():
    """Regression: a dispersion without effect was ignored silently."""
    short = {"base": "level", "duration": "2 s"}
    for dispersions, unfelt in (
        ({"aero.drag.elevator": 1.5}, "aero.drag.elevator"),
        (
            {"wind.gust_start": 1.0, "failure.effector_3.stuck_time": 1.0},
            "'wind.gust_start' and 'failure.effector_3.st",
        ),
    ):
        with pytest.raises(InputError, match=unfelt):
            abhv_mc.fly(short, dispersions=dispersions)
    felt = {"wind.gust_start": 1.0, "wind.gust_north": 3.0, "aero.drag.elevator": 1.0}
    slack = {"actuator.rate_limit": 1.5, "failure.engine.time": "1 h"}  # felt farther out
    for dispersions in (felt, slack):
        assert len(abhv_mc.fly(short, dispersions=dispersions, every=100)) == 3


def test_trims_are_a_table_by_bank():
    table = abhv_mc.trim("ghame", bank=["0 deg", "50 deg"])
    assert table.angle_of_attack_deg.to_list() == pytest.approx([3.59, 4.47], abs=0.01)
    assert table.elevator_deg.to_list() == pytest.approx([-3.91, -5.49], abs=0.01)
    assert table.attrs["units"]["thrust_n"] == "N" and table.trimmed.all()
    level, steep = abhv_mc.trim("ghame_x", bank=["0 deg", "89 deg"]).fault
    assert level is None and "limits" in steep


@pytest.mark.parametrize(
    ("vehicle", "altitude", "speed", "words"),
    [
        ("abhv", "20 km", "1400 m/s", ()),
        ("abhv", "17 km", "1100 m/s", ("mach and altitude",)),
        ("flexible", "15 km", "500 m/s", ("mach",)),
        ("winged_cone", "20 km", "1400 m/s", ("Cn_beta_dyn", "LCDP", "double")),
    ],
)
def test_a_trim_warns_of_its_range_and_of_lateral_stability(vehicle, altitude, speed, words):
    """The limits of abhv begin at Mach 4 and 18 km, the tables of flexible at Mach 2."""
    warnings = abhv_mc.trim(vehicle, altitude, speed, [0.0, 0.1]).attrs["warnings"]
    warned = [text for text in warnings if "outside" in text or "at most" in text]
    assert len(warned) == len(words)
    assert all(word in text for word, text in zip(words, warned, strict=True))


METRIC = "altitude_error_max_m"


def test_a_gain_sweep_needs_no_files(tmp_path):
    content = {
        "name": "sweep",
        "vehicle": {"base": "ghame_x", "mass.start": "1400 kg"},
        "mission": {"base": "level", "duration": "3 s"},
        "controllers": {"tlc": "tlc"},
        "variants": {"tlc.altitude.bandwidth": ["0.03 rad/s", 0.5], "tlc.altitude.damping": 2.4},
        "dispersions": {"aero.drag": {"distribution": "uniform", "half_width": "10 %"}},
        "requirements": [{"metric": METRIC, "below": "0.4 m", "probability": 0.5}],
    }
    campaign = abhv_mc.Campaign.make(content | {"runs": 500}, runs=20)
    names = (
        "tlc",
        *(f"tlc+altitude.bandwidth={x}+altitude.damping=2.4" for x in ("0.03_rad_s", "0.5")),
    )
    assert campaign.runs == 20 and campaign.controllers == names
    results = campaign.run(tmp_path / "out", workers=1)
    assert results.complete and len(results.flights) == 60
    base, same, faster = (
        table[METRIC].tolist() for _, table in results.flights.groupby("controller")
    )
    assert base == same and max(faster) < 0.6 * min(base)
    (text, figure), *_ = draw(None, results._models.names)
    cells = figure.axes[0].collections[0].get_array().ravel()
    assert text.name == "variants"
    assert list(cells) == pytest.approx([max(base), max(faster)], rel=0.01)
    texts = [text.get_text().partition("\n")[2] for text in figure.axes[0].texts]
    assert texts[:2] == ["FAIL", "PASS"]
    assert set(results.flights["failure.case"]) == {"none"}
    again = abhv_mc.Campaign.read(tmp_path / "out" / "campaign.yaml")  # the folder stands alone
    assert again.controllers == campaign.controllers
    varied = abhv_mc.Campaign.make(content, runs=20).vary(
        [{"tlc.rate": 50}], mission="level", runs=9
    )
    varied = abhv_mc.Campaign.read(varied)  # Its files still exist.
    assert varied.controllers == (*names, "tlc+rate=50") and varied.runs == 9
    pd.testing.assert_frame_equal(varied.draw_samples(), campaign.draw_samples(9))
    with pytest.raises(InputError, match="controllers"):
        abhv_mc.Campaign.make({"name": "x", "vehicle": "ghame_x", "mission": "level"})
    with pytest.raises(InputError, match="5; expected a mapping"):
        abhv_mc.Campaign.make(5)


WRONG = [
    (abhv_mc.fly, {"dispersions": {"aero.darg": 1.1}}, r"parameter 'aero\.darg'.*aero\.drag"),
    (abhv_mc.fly, {"dispersions": {"wind.north": "10 kg"}}, r"wind\.north"),
    (abhv_mc.fly, {"dispersions": {"atmosphere.temperature": 280}}, "difference"),
    *(
        (abhv_mc.fly, {"dispersions": {"aero.lift": x}}, r"aero\.lift")
        for x in (math.nan, -math.inf, None, True)
    ),
    (abhv_mc.fly, {"mission": "levle"}, "^levle: "),
    (abhv_mc.fly, {"mission": "x" * 5000}, "^xxxx"),
    (abhv_mc.fly, {"controller": {"base": "tlc", "limit.bank": "60 deg"}}, "'limit'"),
    *((abhv_mc.fly, {"every": x}, r"^every: .*\b1\b") for x in (0, 1.5, "2")),
    (
        abhv_mc.trim,
        {"speed": 0},
        "speed: ",
    ),  # it was divided by; other numbers gave tables of nonsense
    *((abhv_mc.trim, {"altitude": x}, "altitude: ") for x in (1e7, "20 kg")),
    *((abhv_mc.trim, {"bank": x}, "bank: ") for x in ([], math.pi)),
    (abhv_mc.margins, {"at": 90.0}, r"^at: found 90 s; .* 0 to 60 s$"),
    (abhv_mc.margins, {"at": 1.0, "bank": "10 deg"}, r"^bank: .*'trim'"),
    (abhv_mc.margins, {"bank": 1.5}, r"^bank: found 1\.5 rad; .*-80 to 80 deg"),
]


@pytest.mark.parametrize(("call", "arguments", "message"), WRONG)
def test_what_is_wrong_is_said(call, arguments, message):
    with pytest.raises(InputError, match=message):
        call(**({} if call is abhv_mc.trim else {"mission": "level"}) | arguments)


LOOPS = ["aileron", "rudder", "elevator", "equivalence_ratio", "all"]


def test_margins_are_a_table_by_loop_with_units():
    table = abhv_mc.margins("level", "ghame_x", "lqr_retuned_ghame_x")
    assert list(table.index) == LOOPS and table.index.name == "loop"
    assert list(table.attrs["units"]) == list(table.columns)
    assert table.gain_margin_high_db["aileron"] == pytest.approx(
        5.65, abs=0.01
    )  # spec: an independent simulator
    assert table.gain_margin_low_db["rudder"] == -np.inf and np.isnan(
        table.disk_margin["rudder"]
    )  # nothing ends it
    assert table.attrs["stable"] and table.attrs["poles"][0].real < 0.0
    assert any(
        re.search(r"equivalence_ratio .* 1\.0000\b", warning) for warning in table.attrs["warnings"]
    )


def test_a_linear_model_has_names_and_units_and_goes_to_python_control():
    model = abhv_mc.linearize(
        "level", "ghame_x", controller="lqr_retuned_ghame_x", dispersions={"sensor.delay": "10 ms"}
    )
    assert model.period_s == 0.01 and model.measurement_delay_periods == 1
    assert model.plant.A.shape == (18, 18) and list(model.plant.B.columns) == LOOPS[:4]
    assert (
        model.plant.A.attrs["units"]["pitch_rate"] == "rad/s"
        and model.point.attrs["units"]["altitude"] == "m"
    )
    assert model.point["altitude"] == pytest.approx(20_000.0) and model.loop.A.shape == (28, 28)
    poles = control.ss(*model.closed, model.period_s).poles()
    growing = np.log(poles[np.abs(poles) > 0.0].astype(complex)) / model.period_s
    table = abhv_mc.margins(
        "level", "ghame_x", controller="lqr_retuned_ghame_x", dispersions={"sensor.delay": 0.01}
    )
    np.testing.assert_allclose(growing.real.max(), table.attrs["poles"][0].real, rtol=1e-6)
    assert model.law.D.loc["elevator", "pitch_rate"] > 0.0
    assert isinstance(model.point, pd.Series) and model.warnings


@pytest.mark.parametrize(
    "table",
    ["density_factor\n15,1.1\n30,1.2", "pressure_Pa,temperature_K\n15,13e3,240\n30,1300,250"],
)
@pytest.mark.parametrize("vehicle", ["abhv", "flexible"])
def test_all_commands_start_in_the_same_air(tmp_path, table, vehicle):
    """Trim ignored the density table, the bank, the Earth and the custom dynamics of the start."""
    header, *levels = table.split("\n")
    text = "\n".join([f"altitude_m,{header}", *(level.replace(",", "e3,", 1) for level in levels)])
    (tmp_path / "air.csv").write_text(text)
    mission = {
        "base": "flexible",
        "density": {"file": str(tmp_path / "air.csv")},
        "earth": {"gravitational_parameter": "4e14 m3/s2"},
        "start.bank": "20 deg",
    }
    row = abhv_mc.trim(vehicle, mission=mission).iloc[0]
    plan = make_flight_plan(mission, vehicle, "tlc")
    x = plan.initial_state
    controls = math.degrees(math.atan2(x[s.W], x[s.U])), math.degrees(x[s.ELEVATOR]), x[s.ETA]
    trimmed = row[["angle_of_attack_deg", "elevator_deg", "equivalence_ratio"]]
    assert trimmed.tolist() == pytest.approx(controls, rel=1e-9)
    steady = take_point(mission, vehicle, "tlc").plan.reference[0]
    for start in (plan.reference[0], steady):
        mach = start[ref.SPEED] / start[ref.SOUND_SPEED]
        pressure = 0.5 * start[ref.DENSITY] * start[ref.SPEED] ** 2
        assert (row.mach, row.dynamic_pressure_pa) == pytest.approx((mach, pressure), rel=1e-9)
    stored = abhv_mc.fly({**mission, "duration": "1 s"}, vehicle).iloc[0]
    columns = ["mach", "dynamic_pressure_pa"]
    nominal = abhv_mc.trim(vehicle, mission=mission, bank=0.0)["equivalence_ratio"].iloc[0]
    assert plan.reference[0, ref.EQUIVALENCE_RATIO] == pytest.approx(nominal, abs=0.002)
    assert row[columns].tolist() == pytest.approx(stored[columns].tolist(), rel=2e-7)


def test_trim_says_that_it_ignores_wind(tmp_path):
    (tmp_path / "w.csv").write_text("altitude_m,wind_north_mps,wind_east_mps\n0,0,9\n30000,0,9\n")
    mission = {"base": "level", "wind": {"file": str(tmp_path / "w.csv")}}
    assert [w for w in abhv_mc.trim(mission=mission).attrs["warnings"] if "wind" in w]


def test_the_numbers_of_dispersed_flights_trims_and_margins_are_the_stored_ones(tmp_path):
    assert not compare_report("physics", tmp_path)
