"""The lean flight: half as long to compile, and the same bits."""

import numpy as np
import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.flight import fly as flying
from abhv_mc.kernel.flight.fly_lanes import make_fly_lanes
from abhv_mc.simulators.engine import make_engine
from abhv_mc.simulators.make_plans import make_plans

CAMPAIGNS = {  # which of them it flies
    "f16_gust": False,
    "failures": False,
    "harder_vehicle": True,
    "paper": True,
    "s_manoeuvre": True,
    "wide": True,
    "wind_and_air_data": False,
    "wind_and_sensors": False,
    "winged_cone": True,
}


QUICK = ("s_manoeuvre", "winged_cone", *(name for name, lean in CAMPAIGNS.items() if not lean))
SLOW = [pytest.param(name, marks=pytest.mark.thorough) for name in CAMPAIGNS if name not in QUICK]


@pytest.mark.parametrize("name", [*QUICK, *SLOW])
def test_lean_flights_have_the_same_bits(name, repository, monkeypatch):
    campaign = read_campaign(repository / "campaigns" / f"{name}.yaml", 64, None, None)
    plans = make_plans(campaign, campaign.model.controllers, make_engine())
    assert {plan.lean for plan in plans.values()} == {CAMPAIGNS[name]}
    source = campaign.make_samples()
    rows = full_rows(source.names, source.draw(0, 64), ())
    for plan in plans.values() if CAMPAIGNS[name] else ():
        blocks = []
        for lean in (True, False):
            monkeypatch.setattr(flying, "choose_flight", lambda lanes, _, lean=lean: make_fly_lanes(lanes, lean))
            blocks.append(flying.fly(plan, rows, 100))
        for part in ("outcome", "end_time", "metrics", "history"):
            assert np.array_equal(*(getattr(block, part) for block in blocks), equal_nan=True), (plan.controller, part)


def test_a_lean_flight_refuses_what_it_does_not_know(repository):
    campaign = read_campaign(repository / "campaigns" / "s_manoeuvre.yaml", 1, None, None)
    (plan, *_) = make_plans(campaign, ["tlc"], make_engine()).values()
    rows = full_rows(("wind.north",), np.array([[10.0]]), ())
    with pytest.raises(ValueError, match="lean"):
        flying.fly(plan, rows)
