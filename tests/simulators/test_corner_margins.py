"""Margins in steady flight at the corners of a campaign's dispersions."""

import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flight.plan import NOT_LEAN
from abhv_mc.io.input_error import InputError
from abhv_mc.simulators.corner_margins import describe_stability
from abhv_mc.simulators.make_plans import make_plans
from abhv_mc.stability import steady


@pytest.mark.parametrize("name", ["s_manoeuvre", "wide"])
def test_margins_compile_no_other_flight_than_the_campaigns(name, engine, repository, monkeypatch):
    """The full flight was compiled beside the lean one, for trims that fly no tick."""
    campaign = read_campaign(repository / f"campaigns/{name}.yaml")
    plans = make_plans(campaign, campaign.model.controllers, engine)
    begun = []

    def begin(plan, *_):
        begun.append(plan.lean)
        raise InputError("a test", "no flight", "none")

    monkeypatch.setattr(steady, "fly_until", begin)
    assert all(found["fault"] == "no flight" for found in describe_stability(campaign, plans)["controllers"].values())
    assert set(begun) == {plan.lean for plan in plans.values()}
    assert begun[0] == (not any(one.startswith(NOT_LEAN) for one in campaign.varied))
