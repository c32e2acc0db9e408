"""A vehicle without an engine: its trim is a glide, and a law of one's own flies it."""

import numpy as np
import pytest

import abhv_mc
from abhv_mc.io.documents import InputError

GLIDER = {"base": "ghame_x", "propulsion": None}


def test_a_glide_balances_weight_lift_and_drag():
    table = abhv_mc.trim(GLIDER, "32 km", bank=["0 deg", "30 deg"])
    assert table["trimmed"].all() and (table["equivalence_ratio"] == 0.0).all() and (table["thrust_n"] == 0.0).all()
    straight = table.iloc[0]
    # On a round Earth at rest V^2 / r carries part of the weight.
    lift, drag = straight["lift_n"], straight["drag_n"]
    carried = 1.0 - 1400.0**2 / (9.75 * 6.39e6)
    assert np.tan(np.deg2rad(-straight["flight_path_angle_deg"])) == pytest.approx(drag / lift * carried, rel=0.01)
    assert table["flight_path_angle_deg"].iloc[1] < straight["flight_path_angle_deg"]


def test_an_own_law_flies_a_glider():
    mission = {"base": "level", "duration": "8 s", "start.altitude": "32 km"}  # then the air is denser
    flown = abhv_mc.fly(mission, GLIDER, "cascade", every=100)
    assert flown.attrs["outcome"] == "ok"
    angle = abhv_mc.trim(GLIDER, "32 km")["flight_path_angle_deg"].iloc[0]
    assert flown["flight_path_angle_deg"].iloc[0] == pytest.approx(angle, abs=1e-3)
    np.testing.assert_allclose(flown["flight_path_angle_deg"], angle, atol=0.5)
    np.testing.assert_allclose(flown["speed_mps"], 1400.0, atol=15.0)
    assert (flown["thrust_n"] == 0.0).all() and flown["mass_kg"].nunique() == 1


def test_where_no_glide_holds_the_speed_it_slows_down():
    """At 20 km the drag is above the weight."""
    assert abhv_mc.trim(GLIDER)["fault"].iloc[0] == "no flight path angle within the vehicle's limits balances it"
    flown = abhv_mc.fly({"base": "level", "duration": "2 s"}, GLIDER, "cascade", every=100)
    assert flown["flight_path_angle_deg"].iloc[0] == pytest.approx(0.0, abs=1e-6)
    assert flown["speed_mps"].iloc[-1] < 1375.0
    assert any("no flight path angle" in words for words in flown.attrs["warnings"])


def test_laws_that_need_a_throttle_refuse_it():
    with pytest.raises(InputError, match="a law of your own"):
        abhv_mc.fly("level", GLIDER, "tlc")
