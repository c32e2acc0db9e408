"""Margins and linear models from Python without files."""

import control
import numpy as np
import pandas as pd
import pytest

import abhv_mc
from abhv_mc.io.documents import InputError

LOOPS = ["aileron", "rudder", "elevator", "equivalence_ratio", "all"]


def test_margins_are_a_table_by_loop_with_units():
    table = abhv_mc.margins("level", "ghame_x", "lqr_retuned")
    assert list(table.index) == LOOPS and table.index.name == "loop"
    assert list(table.attrs["units"]) == list(table.columns)
    assert table.gain_margin_high_db["aileron"] == pytest.approx(5.65, abs=0.01)  # spec: an independent simulator
    assert table.gain_margin_low_db["rudder"] == -np.inf and np.isnan(table.disk_margin["rudder"])  # nothing ends it
    assert table.attrs["stable"] and table.attrs["poles"][0].real < 0.0
    assert any("near the node 1.0000" in words for words in table.attrs["warnings"])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("controller", "pole", "end"), [("tlc", 8.55, 22.5), ("tlc_robust", 4.08, 25.0), ("lqr_robust", None, 60.0)]
)
def test_a_stuck_aileron_is_lost_where_the_loop_without_it_grows(controller, pole, end):
    """The table of docs/how-to/failures.md."""
    without = abhv_mc.margins(
        "level", "ghame_x", controller=controller, dispersions={"control.aileron_effectiveness": 0.001}
    )
    fastest = without.attrs["poles"][0]
    assert without.attrs["stable"] == (pole is None)
    assert pole is None or (fastest.imag == 0.0 and fastest.real == pytest.approx(pole, abs=0.01))
    flight = abhv_mc.fly(
        "level", "ghame_x", controller=controller, dispersions={"failure.aileron.stuck_time": 20.0}, every=10
    )
    assert flight.attrs["end_time_s"] == pytest.approx(end, abs=0.1)
    plant = abhv_mc.linearize("level", "ghame_x", controller=controller).plant_continuous.A
    effect = plant.loc[["roll_rate", "yaw_rate"], ["aileron", "rudder"]].to_numpy()
    aileron, rudder = np.linalg.solve(effect, [0.0, 1.0])
    np.testing.assert_allclose([rudder, aileron, effect[0, 1] * rudder], [-0.31, 0.16, -14.3], atol=0.05)
    assert np.linalg.cond(effect) == pytest.approx(36.0, abs=0.5)


def test_a_linear_model_has_names_and_units_and_goes_to_python_control():
    model = abhv_mc.linearize("level", "ghame_x", controller="lqr_retuned", dispersions={"sensor.delay": "10 ms"})
    assert model.period_s == 0.01 and model.measurement_delay_periods == 1
    assert model.plant.A.shape == (18, 18) and list(model.plant.B.columns) == LOOPS[:4]
    assert model.plant.A.attrs["units"]["pitch_rate"] == "rad/s" and model.point.attrs["units"]["altitude"] == "m"
    assert model.point["altitude"] == pytest.approx(20_000.0) and model.loop.A.shape == (28, 28)
    poles = control.ss(*model.closed, model.period_s).poles()
    growing = np.log(poles[np.abs(poles) > 0.0].astype(complex)) / model.period_s
    table = abhv_mc.margins("level", "ghame_x", controller="lqr_retuned", dispersions={"sensor.delay": 0.01})
    np.testing.assert_allclose(growing.real.max(), table.attrs["poles"][0].real, rtol=1e-6)
    assert model.law.D.loc["elevator", "pitch_rate"] > 0.0
    assert isinstance(model.point, pd.Series) and model.warnings


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"mission": "levle"}, "no such file"),
        ({"at": 90.0}, "at: 90 s; expected a time of the mission, 0 to 60 s"),
        ({"at": 1.0, "bank": "10 deg"}, "bank: a bank; expected the point 'trim'"),
        ({"bank": 1.5}, "bank: 1.5 rad; expected -80 to 80 deg"),
        ({"controller": {"base": "tlc", "velocity.pth.bandwidth": 1.0}}, "no entry 'velocity.pth'"),
    ],
)
def test_what_is_wrong_is_said(arguments, words):
    with pytest.raises(InputError) as caught:
        abhv_mc.margins(**{"mission": "level", **arguments})
    assert words in str(caught.value)
