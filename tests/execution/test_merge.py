"""Merge of shards, which equals the campaign run as one; incompatible folders."""

import contextlib
import errno
import random
import shutil
from dataclasses import replace

import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, run, write_campaign

from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.folder import envelope_states as collector
from abhv_mc.folder.layout import StorageFullError
from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.io.messages import InputError
from abhv_mc.requests import Request
from abhv_mc.results import open_results

FILES = (
    "samples.parquet",
    "envelopes.parquet",
    "histories/one-000000.parquet",
    "histories/two-000000.parquet",
)


def fly_shards(tmp_path, number=3, **entries):
    campaign = write_campaign(tmp_path / "f", **entries)
    parts = [tmp_path / f"part{i}" for i in range(1, number + 1)]
    for i, folder in enumerate(parts, 1):
        assert run(campaign, folder, shard=(i, number)).complete
    return campaign, parts


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shards")
    fly_shards(folder)
    return folder


@pytest.fixture
def shards(flown, tmp_path):
    """Return copies of a campaign and its three shards."""
    shutil.copytree(flown, tmp_path, dirs_exist_ok=True)
    return tmp_path / "f/campaign.yaml", [tmp_path / f"part{i}" for i in (1, 2, 3)]


@pytest.mark.parametrize(("number", "sampling"), [(4096, "random"), (150, "lhs")])
def test_merged_shards_are_the_whole_campaign(tmp_path, number, sampling, monkeypatch):
    monkeypatch.setattr(collector, "ENVELOPE_FLIGHTS", number)
    campaign, parts = fly_shards(tmp_path, sampling=sampling, execution="{batch: 33}")
    reference = run(campaign, tmp_path / "whole").manifest
    merged = merge_campaign([parts[2], parts[0], parts[1]], tmp_path / "merged", ENGINE)
    assert merged.complete and merged.manifest.digest == reference.digest
    assert (
        merged.manifest.runs_done == 300 and merged.manifest.requirements == reference.requirements
    )
    assert merged.manifest.campaign_hash == reference.campaign_hash
    for name in FILES:
        assert pq.read_table(tmp_path / "whole" / name).equals(
            pq.read_table(tmp_path / "merged" / name)
        )


def test_a_shard_holds_its_flights_only_and_resumes(shards):
    campaign, parts = shards
    assert sorted(set(pq.read_table(parts[1] / "flights")["flight"].to_pylist())) == list(
        range(100, 200)
    )
    next((parts[1] / "flights").glob("one-*")).unlink()
    assert run(campaign, parts[1], shard=(2, 3)).complete
    for shard in (None, (1, 3)):
        with pytest.raises(InputError, match="shard 2/3"):
            run(campaign, parts[1], shard=shard)


def spoil(parts, changes):
    path = parts[1] / "manifest.json"
    write_manifest(path, replace(read_manifest(path), **changes))


def change_seed(parts):
    campaign = write_campaign(parts[1].parent / "g", seed="6")
    run(campaign, parts[1], shard=(2, 3), fresh=True)


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        (change_seed, "seed: 5 -> 6"),
        (lambda parts: spoil(parts, {"source_hash": "0"}), "source hash"),
    ],
)
def test_incompatible_shards_are_rejected(shards, tmp_path, change, pattern):
    _, parts = shards
    change(parts)
    with pytest.raises(InputError, match=pattern):
        merge_campaign(parts, tmp_path / "merged", ENGINE)
    assert not (tmp_path / "merged").exists()


@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.thorough)])
def test_a_flipped_bit_is_reported_or_its_flights_are_run_again(tmp_path, step):
    """A flipped bit is reported, or its flights are run again; shards have no margins."""
    engine = replace(ENGINE, find_stability=lambda campaign, plans: {"runs": campaign.runs})
    keep = (
        "{histories: {flights: [worst 3], rate: 10 Hz}, envelopes: {rate: 2 Hz, channels: "
        "[altitude_m]}}"
    )
    campaign, parts = fly_shards(tmp_path, 2, runs="60", keep=keep, execution="{batch: 15}")
    reference = run(campaign, tmp_path / "whole", engine).manifest
    files = [
        path
        for folder in parts
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != ".lock"
    ]
    chance, again = random.Random(7), []
    for file in files[::step]:
        content = file.read_bytes()
        i = chance.randrange(len(content))
        file.write_bytes(content[:i] + bytes([content[i] ^ 16]) + content[i + 1 :])
        out = tmp_path / "merged"
        try:
            merged = merge_campaign(parts, out, engine)
        except InputError as error:
            assert str(file) in str(error), (file, i)  # noqa: PT017  # others may be flown again
        else:
            again.append(file.parent.name)
            assert merged.complete and merged.manifest.digest == reference.digest, (file, i)
            for name in (*FILES[:3], "margins.json"):
                assert (out / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), (
                    file,
                    i,
                    name,
                )
            assert open_results(out).complete
        file.write_bytes(content)
        shutil.rmtree(out, ignore_errors=True)
    assert set(again) == {"flights", "blocks"}


@pytest.mark.parametrize(
    "fault", [KeyboardInterrupt, OSError(errno.ENOSPC, "No space left on device")]
)
def test_an_interrupted_merge_resumes(tmp_path, monkeypatch, fault):
    """Resume with the same command, although the folder is not empty."""
    campaign, parts = fly_shards(tmp_path, 2, runs="60", execution="{batch: 15}")
    reference = run(campaign, tmp_path / "whole").manifest
    out = tmp_path / "merged"
    left, copy = 0, shutil.copyfile

    def copy_until(source, target, **options):
        nonlocal left
        left -= 1
        if left == 0:
            raise fault
        copy(source, target, **options)

    def fail(*_):
        raise fault

    monkeypatch.setattr(shutil, "copyfile", copy_until)
    for left in (1, 2, 5, 9, 14):  # noqa: B007
        with pytest.raises((KeyboardInterrupt, StorageFullError)):
            merge_campaign(parts, out, ENGINE)
        assert not (out / "manifest.json").exists()
    with contextlib.suppress(KeyboardInterrupt, StorageFullError, OSError):
        assert not merge_campaign(parts, out, replace(ENGINE, find_stability=fail)).complete
    merged = merge_campaign(parts, out, ENGINE)
    assert merged.complete and merged.manifest.digest == reference.digest
    for name in FILES[:2]:
        assert (out / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    with pytest.raises(InputError, match="/whole: "):
        merge_campaign(parts, tmp_path / "whole", ENGINE)


def test_shards_of_another_version_are_rejected_before_writing(shards, tmp_path):
    _, parts = shards
    with pytest.raises(InputError, match="source"):
        merge_campaign(parts, tmp_path / "merged", replace(ENGINE, source="another"))
    assert not (tmp_path / "merged").exists()


def test_shards_with_permuted_controllers_are_merged(tmp_path):
    keys = {"runs": "60", "under_test": "[one]"}
    campaign = write_campaign(tmp_path / "f", **keys)
    order = "{two: two.yaml, one: one.yaml}"
    turned = write_campaign(tmp_path / "g", controllers=order, **keys)
    parts = [tmp_path / "part1", tmp_path / "part2"]
    for i, (file, folder) in enumerate(zip((campaign, turned), parts, strict=True), 1):
        run(file, folder, shard=(i, 2))
    whole = run(campaign, tmp_path / "whole").manifest
    merged = merge_campaign(parts, tmp_path / "merged", ENGINE)
    assert (merged.complete, merged.manifest.digest) == (True, whole.digest)


def test_plans_of_another_folder_are_used(tmp_path):
    campaign, parts = fly_shards(tmp_path, 1)

    def never(*_):
        raise AssertionError("prepared anew")

    request = Request(campaign, tmp_path / "b", shard=(1, 2), plans=parts[0])
    assert run_campaign(request, replace(ENGINE, prepare=never)).complete
    (campaign.parent / "one.yaml").write_text("gain: 3.0\n", "utf-8")
    with pytest.raises(InputError, match=r"inputs/controllers/one/one\.yaml"):
        run(campaign, tmp_path / "c", plans=parts[0])


@pytest.mark.parametrize("shard", [(4, 3), (1, 301)])
def test_invalid_shards_are_rejected(tmp_path, shard):
    with pytest.raises(InputError, match="--shard"):
        run(write_campaign(tmp_path / "f"), tmp_path / "out", shard=shard)
    assert not (tmp_path / "out").exists()
