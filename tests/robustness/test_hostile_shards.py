"""Shards made to harm who merges them: refused in words or flown again, and nothing half merged is left."""

import os
import shutil
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, write_campaign

from abhv_mc.cli.app import main
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder import envelope_states as collector
from abhv_mc.folder.arrays import write_array
from abhv_mc.folder.flights import read_block, write_block
from abhv_mc.folder.layout import hash_file
from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.folder.samples import SampleReader


def fly(root, **options):
    keep = "{histories: {flights: none}, envelopes: {rate: 2 Hz, channels: [altitude_m]}}"
    campaign = write_campaign(root / "f", runs="40", keep=keep, execution="{batch: 10}")
    for i in (1, 2):
        run_campaign(Request(campaign, root / f"part{i}", shard=(i, 2)), ENGINE)
    return campaign, run_campaign(Request(campaign, root / "whole"), ENGINE).manifest["digest"]


@pytest.fixture(scope="module", params=["exact", "histograms"])
def shards(request, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "histograms":
            patch.setattr(collector, "EXACT_FLIGHTS", 0)
        root = tmp_path_factory.mktemp("shards")
        yield root, fly(root)[1]


@pytest.fixture
def merge(shards, tmp_path, monkeypatch, capfd):
    """Spoil the second shard, sign it, merge; gives the exit code, what was said and the merged digest."""
    monkeypatch.setattr("abhv_mc.execution.runner.make_engine", lambda: ENGINE)
    monkeypatch.chdir(tmp_path)

    def call(spoil, **entries):
        parts = [shutil.copytree(shards[0] / f"part{i}", tmp_path / f"part{i}") for i in (1, 2)]
        changed = spoil(parts[1]) or {}
        manifest = read_manifest(parts[1] / "manifest.json")
        names = {path.relative_to(parts[1]).as_posix() for path in parts[1].rglob("*") if path.is_file()}
        files = {name: hash_file(parts[1] / name) for name in names - {"manifest.json", ".lock"}}
        write_manifest(parts[1] / "manifest.json", manifest | {"files": files} | changed)
        monkeypatch.setattr(sys, "argv", ["abhv-mc", "merge", *map(str, parts), "-o", "out", "--no-report"])
        with pytest.raises(SystemExit) as caught:
            main()
        said = "".join(capfd.readouterr())
        assert "Traceback" not in said and "\x1b" not in said, said
        out = tmp_path / "out/manifest.json"
        return caught.value.code or 0, said, read_manifest(out)["digest"] if out.exists() else None

    return call


@pytest.mark.parametrize(
    "entries",
    [
        {"shard": [2, 10**12]},
        {"shard": [10**12, 10**12]},
        {"shard": [1, 2]},
        {"shard": [3, 2]},
        {"digest": "f" * 500},
        {"digest": "0"},
        {"wall_time_s": 1e308},
        {"campaign_hash": "0"},
        {"source_hash": "other"},
        {"controllers": {}},
        {"inputs": {"inputs/../../x": "0"}},
        {"files": {}},
    ],
)
def test_manifests(shards, merge, entries):
    code, said, digest = merge(lambda part: entries)
    assert code == 2 or (code in (0, 1) and digest == shards[1]), (code, said)


def blocks_of(part):
    return sorted((part / "flights").glob("*.parquet"))


def other_numbers(part):
    """Flights that never flew so: their digests fit the manifest."""
    names = SampleReader(part / "samples.parquet").names
    for path in blocks_of(part):
        block = read_block(path, names)
        block.values[:] += 1.0
        write_block(path.parent, block, pq.read_schema(path))


def flights_of_the_first(part):
    for path in blocks_of(part.parent / "part1"):
        shutil.copyfile(path, part / "flights" / path.name)


def beyond(part):
    path = blocks_of(part)[0]
    path.rename(path.with_name("one-000000990-000001000.parquet"))


def huge_name(part):
    path = blocks_of(part)[0]
    path.rename(path.with_name("one-000000000-999999999999999999.parquet"))


def bad_words(part):
    path = blocks_of(part)[0]
    table = pq.read_table(path, partitioning=None)
    words = pa.array(["\x1b[2J"] * len(table))
    pq.write_table(table.set_column(2, table.schema.field(2), words), path)


def link(part):
    path = blocks_of(part)[0]
    path.unlink()
    path.symlink_to("/etc/hostname")


def pipe(part):
    path = blocks_of(part)[0]
    path.unlink()
    os.mkfifo(path)


def bad_states(part):
    for path in (part / "envelope_states").rglob("*.npz"):
        with np.load(path) as stored:
            np.savez(path, **{**stored, "width": stored["width"] * 0})
    for path in (part / "envelope_states").rglob("*.npy"):
        write_array(path, np.zeros((3, 3)))


def states_of_the_first(part):
    shutil.rmtree(part / "envelope_states")
    shutil.copytree(part.parent / "part1/envelope_states", part / "envelope_states")


def strange_states(part):
    write_array(part / "envelope_states/blocks/one-000000000-000000100.npy", np.zeros((102, 5), np.float32))
    write_array(part / "envelope_states/blocks/three-x-y.npy", np.zeros((102, 5), np.float32))
    (part / "envelope_states/evil.npz").write_bytes(b"PK")


def bad_plan(part):
    (part / "plans/one.npz").write_bytes(b"PK\x03\x04")


def no_samples(part):
    (part / "samples.parquet").write_bytes(b"PAR1PAR1")


SPOILS = (
    *(other_numbers, flights_of_the_first, beyond, huge_name, bad_words, link, pipe, bad_states),
    *(states_of_the_first, strange_states, bad_plan, no_samples),
)


@pytest.mark.parametrize("spoil", SPOILS)
def test_files(shards, merge, tmp_path, spoil):
    code, said, digest = merge(spoil)
    assert code in (0, 1, 2), said
    if code != 2:
        assert digest == shards[1], "another campaign than the whole one"
    elif spoil is not other_numbers:  # whose digests tell, once all is there
        assert not (tmp_path / "out").exists() or not any((tmp_path / "out").iterdir()), sorted(
            (tmp_path / "out").iterdir()
        )
