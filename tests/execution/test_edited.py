"""Files that a campaign refers to, edited while it flies, or just before: it flies what it says that it flies."""

from dataclasses import replace

import pytest
from fake_flight import ENGINE, fly, prepare, write_campaign

from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.flight.metrics import METRICS
from abhv_mc.io.input_error import InputError
from abhv_mc.search.search_flights import SearchRequest
from abhv_mc.search.worst import WorstSettings, find_worst

FILES = ("vehicle.yaml", "tables/cl.csv", "mission.yaml", "one.yaml")
KEEP = "{envelopes: {rate: 5 Hz}}"


@pytest.fixture
def campaign(tmp_path):
    return write_campaign(tmp_path / "f", runs="60", execution="{batch: 15}", keep=KEEP)


def edit(campaign, name):
    file = campaign.parent / name
    file.write_text(f"{file.read_text()}# edited\n")


def find_stability(campaign, plans):
    """What the vehicle's file holds when its margins are taken."""
    vehicle = campaign.model.vehicle
    return {"vehicle": vehicle.read_text() + (vehicle.parent / "tables/cl.csv").read_text()}


@pytest.mark.parametrize("name", FILES)
def test_margins_are_of_the_files_that_fly(campaign, tmp_path, name):
    """They were of the edited vehicle, beside flights and copies of the other, and every number 'followed'."""
    engine = replace(ENGINE, find_stability=find_stability)
    whole = run_campaign(Request(campaign, tmp_path / "whole"), engine)

    out = tmp_path / "out"

    def fly_and_edit(plan, parameters, every=None):
        if (out / "manifest.json").exists() and "edited" not in (campaign.parent / name).read_text():
            edit(campaign, name)
        return fly(plan, parameters, every)

    flown = run_campaign(Request(campaign, out, workers=1), replace(engine, fly=fly_and_edit))
    assert "edited" in (campaign.parent / name).read_text()
    assert flown.manifest["digest"] == whole.manifest["digest"]
    assert (out / "margins.json").read_bytes() == (tmp_path / "whole/margins.json").read_bytes()


def edited_while_preparing(campaign, name):
    def prepare_and_edit(vehicle, mission, controller, which):
        plan = prepare(vehicle, mission, controller, which)
        edit(campaign, name)
        return plan

    return replace(ENGINE, prepare=prepare_and_edit)


@pytest.mark.parametrize("name", FILES)
def test_an_edit_while_plans_are_made_is_told_and_leaves_nothing(campaign, tmp_path, name):
    with pytest.raises(InputError, match=rf"{name}.* a file was edited meanwhile"):
        run_campaign(Request(campaign, tmp_path / "out"), edited_while_preparing(campaign, name))
    assert not (tmp_path / "out").exists()


def test_an_edit_while_the_plan_of_another_controller_is_made(campaign, tmp_path):
    run_campaign(Request(campaign, tmp_path / "out", controllers=("one",)), ENGINE)
    with pytest.raises(InputError, match="a file was edited meanwhile"):
        run_campaign(Request(campaign, tmp_path / "out"), edited_while_preparing(campaign, "two.yaml"))
    assert not (tmp_path / "out/plans/two.npz").exists()


def test_an_edit_while_the_plan_of_a_search_is_made(campaign, tmp_path):
    request = SearchRequest(campaign, tmp_path / "out", "one", workers=1)
    with pytest.raises(InputError, match="a file was edited meanwhile"):
        find_worst(request, WorstSettings(METRICS[0].name, 64), edited_while_preparing(campaign, "vehicle.yaml"))
    assert not (tmp_path / "out").exists()
