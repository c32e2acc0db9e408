"""Input files are read once: edits during setup or run have no effect."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from fake_flight import ENGINE, fly, prepare, run, write_campaign

from abhv_mc.folder.hashes import read_checked
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.input_files import read_input
from abhv_mc.requests import WorstRequest
from abhv_mc.search.worst import find_worst
from abhv_mc_vehicle.flight.metrics import METRICS

FILES = ("vehicle.yaml", "tables/cl.csv", "mission.yaml", "one.yaml")


ENTRIES = {"runs": "60", "execution": "{batch: 15}", "keep": "{envelopes: {rate: 5 Hz}}"}


@pytest.fixture
def campaign(tmp_path, capfd):
    return write_campaign(tmp_path / "f", **ENTRIES)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return run(write_campaign(folder / "f", **ENTRIES), folder / "out", WITH_STABILITY)


def find_stability(campaign, plans):
    """Return the content of the vehicle's files at the end of a run, instead of margins."""
    vehicle = campaign.model.vehicle
    return {
        "vehicle": (read_input(vehicle) + read_input(vehicle.parent / "tables/cl.csv")).decode()
    }


WITH_STABILITY = replace(ENGINE, find_stability=find_stability)


def edit(file):
    if "edited" not in file.read_text():
        file.write_text(f"{file.read_text()}# edited\n")


def editing(file, when):
    def prepare_and_edit(*files):
        plan = prepare(*files)
        if when == "prepare":
            edit(file)
        return plan

    def fly_and_edit(plan, parameters, every=None):
        edit(file)
        return fly(plan, parameters, every)

    return replace(WITH_STABILITY, prepare=prepare_and_edit, fly=fly_and_edit)


@pytest.mark.parametrize(
    ("name", "when"), list(zip(FILES, ("prepare", "fly", "prepare", "fly"), strict=True))
)
def test_a_run_uses_the_files_as_read(reference, campaign, tmp_path, name, when):
    flown = run(campaign, tmp_path / "out", editing(campaign.parent / name, when))
    assert "edited" in (campaign.parent / name).read_text()
    assert flown.manifest.digest == reference.manifest.digest
    assert flown.manifest.inputs == reference.manifest.inputs
    assert read_checked(CampaignFolder(tmp_path / "out")).files == flown.manifest.files
    assert (tmp_path / "out/margins.json").read_bytes() == (
        reference.folder / "margins.json"
    ).read_bytes()


def test_a_search_uses_the_files_as_read(campaign, tmp_path):
    request = WorstRequest(
        campaign, tmp_path / "out", METRICS[0].name, controller="one", workers=1, flights=160
    )
    find_worst(request, editing(campaign.parent / "vehicle.yaml", "prepare"))
    assert "edited" not in (tmp_path / "out/inputs/vehicle/vehicle.yaml").read_text()


def test_each_input_is_opened_once(campaign, tmp_path, monkeypatch):
    opened, read = Counter(), Path.read_bytes

    def count(path):
        opened[path.resolve()] += 1
        return read(path)

    monkeypatch.setattr(Path, "read_bytes", count)
    run(campaign, tmp_path / "out", WITH_STABILITY)
    files = [campaign, *(campaign.parent / name for name in (*FILES, "two.yaml"))]
    assert [opened[path] for path in files] == [1] * len(files)
