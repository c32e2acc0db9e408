"""A user's filter before a law of the program, and settings of vehicle functions as parameters."""

import numpy as np
import pytest
from short_flights import cut

from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.io.input_error import InputError
from abhv_mc.one_flight.fly_once import fly as fly_table
from abhv_mc.one_flight.given import make_flight_plan

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
    (folder / "filter.py").write_text(FILTER.replace("MEASURED", value), encoding="utf-8")
    (folder / "filter.yaml").write_text(
        f"law: python\nfile: filter.py\naround: {around}.yaml\n", encoding="utf-8"
    )
    from abhv_mc.shipped import find_input

    text = find_input(around, "control").read_text(encoding="utf-8")
    (folder / f"{around}.yaml").write_text(text, encoding="utf-8")
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


def test_a_filter_needs_a_controller_around_it(tmp_path):
    write_filter(tmp_path, "last")
    (tmp_path / "filter.yaml").write_text("law: python\nfile: filter.py\n", encoding="utf-8")
    with pytest.raises(InputError, match="a filter without the controller"):
        make_flight_plan("level", "abhv", str(tmp_path / "filter.yaml"))


def test_a_setting_is_a_parameter_of_one_flight():
    slow = {"dynamics.frequency_1": "17 rad/s"}
    nominal = fly_table("flexible", "flexible", "tlc", every=100)
    moved = fly_table("flexible", "flexible", "tlc", slow, every=100)
    assert not np.array_equal(nominal["state.mode_1"], moved["state.mode_1"])
    with pytest.raises(InputError, match=r"dynamics\.frequency_1"):
        fly_table("flexible", "flexible", "tlc", {"dynamics.frequenc_1": 17.0})
