"""Flights that are run again and compared with the stored flights."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from fake_flight import fly, run, write_campaign

from abhv_mc.analysis.replay import find_rows, replay_flight
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.repeatability import Repeatability
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import read_manifest, write_manifest


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("replay")
    return run(write_campaign(folder / "f", runs="70"), folder / "out", workers=1).folder


def test_rows_are_those_of_the_flights_in_the_given_order(flown):
    stored = read_flown(flown).flights["two"].metrics["altitude_error_max_m"]
    rows = find_rows(CampaignFolder(flown), "two", [69, 3, 64])
    assert [row.first for row in rows] == [69, 3, 64]
    column = rows[0].columns.index("altitude_error_max_m")
    assert [row.values[0, column] for row in rows] == stored[[69, 3, 64]].tolist()


@pytest.mark.parametrize(
    ("factor", "repeatable", "differs"),
    [
        (1.0 + 1e-12, None, True),
        (1.0 + 1e-12, Repeatability.ROUNDING, False),
        (1.0 + 1e-8, Repeatability.ROUNDING, True),
    ],
)
def test_differing_values_and_outcomes_are_listed(flown, tmp_path, factor, repeatable, differs):
    def other(plan, parameters, every=None):
        block = fly(plan, parameters, every)
        block.metrics[:, 1] *= factor
        outcome = Outcome.BANK_LIMIT if differs else block.outcome[0]
        return replace(block, outcome=np.full(1, outcome))

    folder = shutil.copytree(flown, tmp_path / "out")
    manifest = folder / "manifest.json"
    write_manifest(manifest, replace(read_manifest(manifest), repeatable=repeatable))
    replay = replay_flight(folder, "two", 3, other)
    names = [text.split(":")[0] for text in replay.differences]
    assert names == ([[*replay.metrics][1], "outcome"] if differs else [])
