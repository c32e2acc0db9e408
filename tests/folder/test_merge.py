"""Merge of shards and of campaigns with other seeds, before the missing files are computed."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import run, write_campaign

from abhv_mc.folder.controller_flights import read_flights
from abhv_mc.folder.flights import SampleReader
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import Pooled, join_flyers, read_manifest, write_manifest
from abhv_mc.folder.merge import (
    check_poolable,
    is_merged,
    join_shards,
    list_seeds,
    order_shards,
    pool_campaigns,
    require_same_requirements,
    suggest_merge,
)
from abhv_mc.io.messages import InputError

ENTRIES = {
    "runs": "30",
    "execution": "{workers: 1, batch: 8}",
    "keep": "{histories: {flights: []}}",
}


def read(folder):
    folder = CampaignFolder(folder)
    return read_manifest(folder.manifest), read_flights(folder.flights)


def spoil(folder, **changes):
    path = folder / "manifest.json"
    write_manifest(path, replace(read_manifest(path), **changes))


def test_shards_are_ordered_and_joined(tmp_path):
    file = write_campaign(tmp_path / "f", **ENTRIES)
    parts = [run(file, tmp_path / f"p{i}", shard=(i, 3)).folder for i in (1, 2, 3)]
    for chosen, problem in (
        (parts[:2], "shard 3 of 3 is missing"),
        ([*parts, parts[1]], "shard 2/3 is given twice"),
        ([run(file, tmp_path / "whole").folder], "not a shard"),
    ):
        with pytest.raises(InputError, match=problem):
            order_shards(chosen)
    shards = order_shards([parts[2], parts[0], parts[1]])
    assert [shard.root for shard in shards] == parts
    require_same_requirements(shards)
    join_shards(shards, tmp_path / "out")
    manifest, flights = read(tmp_path / "out")
    manifests = [read_manifest(part / "manifest.json") for part in parts]
    assert (manifest.shard, manifest.state) == (None, "interrupted")
    assert manifest.merged_from == tuple(own.digest for own in manifests)
    assert manifest.wall_time_s == pytest.approx(sum(own.wall_time_s for own in manifests))
    _, whole = read(tmp_path / "whole")
    for name, own in whole.items():
        assert flights[name].flight.tolist() == own.flight.tolist() == list(range(30))
        assert np.array_equal(flights[name].end_time, own.end_time)
    join_shards(shards, tmp_path / "out")  # again without effect
    with pytest.raises(InputError, match="not empty"):
        join_shards(shards[::-1], tmp_path / "out")
    samples = parts[1] / "samples.parquet"
    pq.write_table(pq.read_table(samples).take([*range(1, 30), 0]), samples)
    spoil(parts[1], files={}, shard=(2, 4))
    with pytest.raises(InputError, match="shard 2/4 is not one of 3 shards"):
        order_shards(parts)
    with pytest.raises(InputError, match="samples differ"):
        join_shards(shards, tmp_path / "new")
    spoil(parts[1], state="interrupted", shard=(2, 3))
    with pytest.raises(InputError, match="'interrupted'"):
        order_shards(parts)


def test_campaigns_of_other_seeds_follow_each_other(tmp_path):
    file = write_campaign(tmp_path / "f", **ENTRIES)
    paths = [
        run(file, tmp_path / name, seed=seed, runs=runs).folder
        for name, seed, runs in (("a", 5, 30), ("b", 6, 20), ("c", 6, 24), ("d", 7, 10))
    ]
    manifests = [read_manifest(path / "manifest.json") for path in paths]
    sentence, command = suggest_merge(paths[0], manifests[0])
    # The larger campaign of each seed is named.
    assert "'c' (24 flights: 1 " in sentence and "'d' (10 flights: 1 " in sentence
    assert "'b'" not in sentence
    assert command.split()[1:] == [
        "merge",
        *(str(paths[i]) for i in (0, 2, 3)),
        "-o",
        f"{paths[0]}_merged",
    ]
    for chosen, problem in ((paths[1:3], "seed 6"), ([paths[0], tmp_path / "f"], "no such file")):
        with pytest.raises(InputError, match=problem):
            check_poolable(chosen)
    spoil(paths[3], flown_by=join_flyers(()), wall_time_s=100.0)
    folders = check_poolable([paths[0], paths[3], paths[1]])
    pool_campaigns(folders, tmp_path / "out")
    pooled, flights = read(tmp_path / "out")
    assert pooled.pooled == (Pooled(5, 30), Pooled(7, 10), Pooled(6, 20))
    assert list_seeds(pooled) == {5, 6, 7} and list_seeds(manifests[0]) == {5}
    assert (pooled.runs_planned, pooled.state, pooled.seed) == (60, "interrupted", 5)
    assert 100.0 < pooled.wall_time_s < 200.0
    parts = [read(folder.root)[1] for folder in folders]
    for name, own in flights.items():
        assert own.flight.tolist() == list(range(60))
        times = np.concatenate([part[name].metrics["altitude_error_max_m"] for part in parts])
        assert np.array_equal(own.metrics["altitude_error_max_m"], times)
    assert not (tmp_path / "out/samples.parquet").exists()
    assert SampleReader(folders[0].samples).flights == 30
    order = [read_manifest(folder.manifest) for folder in folders]
    assert is_merged(CampaignFolder(tmp_path / "out"), order)
    assert not is_merged(CampaignFolder(tmp_path / "new"), order)
    with pytest.raises(InputError, match="not empty"):
        is_merged(CampaignFolder(tmp_path / "out"), order[::-1])
