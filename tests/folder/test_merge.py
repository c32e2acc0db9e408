"""Merge of shards and of campaigns with other seeds, before the missing files are computed."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import run, write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.folder.controller_flights import read_flights
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import Pooled, read_manifest, write_manifest
from abhv_mc.folder.merge import (
    check_poolable,
    join_shards,
    order_shards,
    pool_campaigns,
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
    join_shards(shards, tmp_path / "out")
    manifest, flights = read(tmp_path / "out")
    manifests = [read_manifest(part / "manifest.json") for part in parts]
    assert (manifest.shard, manifest.state) == (None, "interrupted")
    assert manifest.merged_from == tuple(own.digest for own in manifests)
    _, whole = read(tmp_path / "whole")
    for name, own in whole.items():
        assert flights[name].flight.tolist() == own.flight.tolist() == list(range(30))
        assert np.array_equal(flights[name].end_time, own.end_time)
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
    """The first campaign has fewer flights than samples."""
    file = write_campaign(tmp_path / "f", **ENTRIES, stop="when proven")
    a, b, c, d = (
        run(file, tmp_path / name, seed=seed, runs=runs).folder
        for name, seed, runs in (("a", 5, 400), ("b", 6, 20), ("c", 6, 24), ("d", 7, 10))
    )
    first = read_manifest(a / "manifest.json")
    sentence, command = suggest_merge(a, first)
    # The larger campaign of each seed is named.
    assert "'c' (24 flights: 1 " in sentence and "'d' (10 flights: 1 " in sentence
    assert command.split()[1:] == ["merge", *map(str, (a, c, d)), "-o", f"{a}_merged"]
    late = replace(first.requirements[0], probability=0.8)
    estimates = [replace(own, verdict="ESTIMATE") for own in first.requirements]
    for changes in (
        {"state": "interrupted"},
        {"requirements": ()},
        {"requirements": (*estimates,)},
        {"requirements": (late, *first.requirements[1:])},
        {"question": "other"},
        {"source_hash": "other"},
    ):
        assert suggest_merge(a, replace(first, **changes)) == ("", "")
    pooled_already = replace(first, pooled=(Pooled(5, 80), Pooled(6, 20)))
    assert suggest_merge(a, pooled_already)[1].split()[2:4] == [str(a), str(d)]
    with pytest.raises(InputError, match="seed 6"):
        check_poolable([b, c])
    pool_campaigns(check_poolable([a, d, b]), tmp_path / "out")
    manifest, flights = read(tmp_path / "out")
    assert manifest.seed == read_campaign(tmp_path / "out/campaign.yaml").seed == 5
    assert manifest.started == first.started and manifest.stopped_at is None
    assert manifest.pooled == (Pooled(5, first.stopped_at), Pooled(7, 10), Pooled(6, 20))
    assert manifest.runs_planned == first.stopped_at + 30 < 400
    parts = [read(folder)[1]["two"].end_time for folder in (a, d, b)]
    assert flights["two"].flight.tolist() == list(range(first.stopped_at + 30))
    assert np.array_equal(flights["two"].end_time, np.concatenate(parts))
    counts = read_manifest(d / "manifest.json").controllers
    spoil(d, controllers={**counts, "two": replace(counts["two"], flights_done=8)})
    pool_campaigns([CampaignFolder(d), CampaignFolder(b)], tmp_path / "shorter")
    shorter = read_manifest(tmp_path / "shorter/manifest.json")
    assert shorter.pooled == (Pooled(7, 8), Pooled(6, 20)) and shorter.runs_planned == 28
    for folder, changes in ((c, {"state": "interrupted"}), (d, {"search": {"kind": "rare"}})):
        spoil(folder, **changes)
        with pytest.raises(InputError, match="incomplete") as caught:
            check_poolable([a, folder])
        assert caught.value.file == str(folder)
    spoil(d, search=None)
    assert "'b' (20 flights" in suggest_merge(a, first)[0]
