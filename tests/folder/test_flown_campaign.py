from dataclasses import replace

import numpy as np
import pytest
from report.synthetic import CONTROLLERS, write_campaign

from abhv_mc.bounds import Bounds
from abhv_mc.flight.metrics import METRICS
from abhv_mc.folder.flown_campaign import read_flown, read_histories
from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.io.documents import InputError


def test_a_folder_reads_as_arrays(failing):
    assert failing.controllers == CONTROLLERS
    assert len(failing.metrics) == len(METRICS)
    assert failing.flights["lqr"].flight.tolist() == list(range(100))
    assert failing.flights["lqr"].failed.sum() == 12
    assert not failing.flights["tlc"].failed.any()
    density = failing.samples["atmosphere.density"]
    assert set(np.argsort(density)[-12:]) == set(np.flatnonzero(failing.flights["lqr"].failed))
    requirement = failing.campaign.requirements[0]
    assert (requirement.limits, requirement.controllers) == (Bounds(high=50.0), ("tlc",))
    assert requirement.early_is_failure


def test_histories_are_those_kept(failing_folder):
    kept = read_histories(failing_folder, "lqr")
    assert len(kept) == 20
    assert all(len(history["time"]) == 601 for history in kept.values())


def test_a_shard_is_no_campaign_yet(tmp_path):
    folder = write_campaign(tmp_path / "c", runs=4)
    path = folder / "manifest.json"
    write_manifest(path, replace(read_manifest(path), shard=(1, 3)))
    with pytest.raises(InputError, match="shard 1/3 of a campaign"):
        read_flown(folder)
