"""A user's filter before a law of the program, and settings of vehicle functions as parameters."""

import numpy as np
import pytest
from short_flights import cut

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import find_input
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.prepare import prepare
from abhv_mc_vehicle.kernel.flight.fly_lanes import COMPACTION
from abhv_mc_vehicle.one_flight.fly_once import fly as fly_table
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.vehicle_simulator.make_plans import make_plans

FILTER = """
from typing import NamedTuple
from abhv_mc.extend import Filtered, measurement_filter

class Memory(NamedTuple):
    last: float = 0.0

@measurement_filter
def law(measured, memory, time, dt):
    last = measured.pitch_rate if time == 0.0 else memory.last
    return Filtered(pitch_rate=MEASURED), Memory(measured.pitch_rate)
"""


def write_filter(folder, value, around="tlc"):
    (folder / "filter.py").write_text(FILTER.replace("MEASURED", value), "utf-8")
    (folder / "filter.yaml").write_text(
        f"law: python\nfile: filter.py\naround: {around}.yaml\n", "utf-8"
    )

    text = find_input(around, "control").read_text("utf-8")
    (folder / f"{around}.yaml").write_text(text, "utf-8")
    return str(folder / "filter.yaml")


@pytest.mark.parametrize("around", ["tlc", "lqr"])
def test_a_filter_that_changes_nothing_leaves_the_bits(tmp_path, around):
    plain = cut(make_flight_plan("level", "abhv", around), 100)
    own = cut(
        make_flight_plan("level", "abhv", write_filter(tmp_path, "measured.pitch_rate", around)),
        100,
    )
    rows = nominal_parameters(2)
    rows[1] *= 1.0
    ours, theirs = fly(own, rows, 10), fly(plain, rows, 10)
    assert np.array_equal(ours.history, theirs.history, equal_nan=True)


def test_a_filter_of_one_tick_is_a_delay_of_one(tmp_path):
    own = cut(make_flight_plan("s_manoeuvre", "abhv", write_filter(tmp_path, "last")), 300)
    block = fly(own, nominal_parameters(), 1)
    names = [channel.name for channel in own.channels]
    measured = block.history[0][:, names.index("pitch_rate_measured_dps")]
    true = block.history[0][:, names.index("pitch_rate_dps")]
    np.testing.assert_array_equal(measured[1:], true[:-1])
    assert np.ptp(true) > 0.1


def test_a_filter_that_is_not_finite_is_rejected_with_its_line(tmp_path):
    path = write_filter(tmp_path, "(last - last) / (last - last)")
    with pytest.raises(InputError) as caught:
        make_flight_plan("level", "abhv", path)
    error = caught.value
    assert (error.file, error.line) == (str(tmp_path / "filter.py"), 9)
    assert " at 0 s" in error.found and "Filtered(...)" in error.expected


def test_a_filter_needs_a_controller_around_it(tmp_path):
    write_filter(tmp_path, "last")
    (tmp_path / "filter.yaml").write_text("law: python\nfile: filter.py\n", "utf-8")
    with pytest.raises(InputError, match=r"filter\.\w+\S*: .*'around'"):
        make_flight_plan("level", "abhv", str(tmp_path / "filter.yaml"))


def test_a_setting_is_a_parameter_of_one_flight():
    slow = {"dynamics.frequency_1": "17 rad/s"}
    nominal = fly_table("flexible", "flexible", "tlc", every=100)
    moved = fly_table("flexible", "flexible", "tlc", slow, every=100)
    assert not np.array_equal(nominal["state.mode_1"], moved["state.mode_1"])
    with pytest.raises(InputError, match=r"dynamics\.frequency_1"):
        fly_table("flexible", "flexible", "tlc", {"dynamics.frequenc_1": 17.0})


LAW = """
from typing import NamedTuple
from abhv_mc.extend import Command, controller

class Settings(NamedTuple):
    gain: float = 1.0
    lag: float = 0.0

@controller(dispersable=("gain",))
def law(measured, reference, settings):
    return Command(0.0, 0.0, settings.gain * 0.01 + settings.lag, reference.equivalence_ratio)
"""


def test_a_setting_of_a_law_is_a_parameter_of_its_flights(tmp_path):
    (tmp_path / "own.py").write_text(LAW, "utf-8")
    (tmp_path / "own.yaml").write_text(
        "law: python\nfile: own.py\nsettings: {gain: 2.0}\n", "utf-8"
    )
    file = tmp_path / "campaign.yaml"
    file.write_text(
        f"""name: own
question: What does its gain change?
vehicle: {find_input("abhv", "vehicle")}
mission: {find_input("level", "mission")}
controllers: {{own: own.yaml, lqr: {find_input("lqr", "control")}}}
runs: 40
dispersions:
  law.gain: {{distribution: uniform, half_width: 50 %}}
""",
        "utf-8",
    )
    campaign = read_campaign(file)
    assert campaign.parameters["law.gain"].nominal == 2.0
    rows = campaign.rows(campaign.make_samples().draw(0, 40))
    plans = make_plans(campaign, campaign.controllers, prepare)
    own, lqr = (fly(cut(plans[name], 20), rows, 10) for name in ("own", "lqr"))
    names = [channel.name for channel in plans["own"].channels]
    commands = np.deg2rad(own.history[:, 1, names.index("elevator_command_deg")])
    np.testing.assert_allclose(commands, 0.01 * rows[:, -1], rtol=1e-6)
    assert np.ptp(rows[:, -1]) > 0.1
    assert np.array_equal(lqr.metrics[0], lqr.metrics[1], equal_nan=True)
    nominal = fly(cut(plans["own"], 20), nominal_parameters(), 10)
    command = np.deg2rad(nominal.history[0, 1, names.index("elevator_command_deg")])
    assert command == pytest.approx(0.02, rel=1e-6)
    # The setting follows its flight when lanes are reassigned.
    longer = cut(plans["own"], COMPACTION + 50)
    alone = fly(longer, rows[:1], 50)
    np.testing.assert_array_equal(fly(longer, rows, 50).history[0], alone.history[0])
