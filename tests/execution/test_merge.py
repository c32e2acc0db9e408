"""Shards flown apart and merged are the campaign flown whole; what does not fit is refused."""

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
from abhv_mc.io.input_error import InputError
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
    for i, part in enumerate(parts, 1):
        assert run(campaign, part, shard=(i, number)).complete
    return campaign, parts


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shards")
    fly_shards(folder)
    return folder


@pytest.fixture
def shards(flown, tmp_path):
    """A campaign and its three shards, copied."""
    shutil.copytree(flown, tmp_path, dirs_exist_ok=True)
    return tmp_path / "f/campaign.yaml", [tmp_path / f"part{i}" for i in (1, 2, 3)]


@pytest.mark.parametrize(("number", "sampling"), [(4096, "random"), (150, "lhs")])
def test_merged_shards_are_the_whole_campaign(tmp_path, number, sampling, monkeypatch):
    monkeypatch.setattr(collector, "ENVELOPE_FLIGHTS", number)
    campaign, parts = fly_shards(tmp_path, sampling=sampling, execution="{batch: 33}")
    whole = run(campaign, tmp_path / "whole").manifest
    merged = merge_campaign([parts[2], parts[0], parts[1]], tmp_path / "merged", ENGINE)
    assert merged.complete and merged.manifest.digest == whole.digest
    assert merged.manifest.runs_done == 300 and merged.manifest.requirements == whole.requirements
    assert merged.manifest.campaign_hash == whole.campaign_hash
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
    ("change", "words"),
    [
        (lambda parts: parts.pop(), "shard 3 of 3"),
        (lambda parts: parts.append(parts[0]), "shard 1/3"),
        (lambda parts: spoil(parts, {"state": "interrupted"}), "shard is interrupted"),
        (change_seed, "seed: 5 -> 6"),
        (lambda parts: spoil(parts, {"source_hash": "0"}), "source hash"),
        (lambda parts: spoil(parts, {"shard": None}), "--shard i/n"),
    ],
)
def test_what_does_not_fit_is_refused(shards, tmp_path, change, words):
    _, parts = shards
    change(parts)
    with pytest.raises(InputError, match=words):
        merge_campaign(parts, tmp_path / "merged", ENGINE)
    assert not (tmp_path / "merged").exists()


@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.thorough)])
def test_a_flipped_bit_in_a_part_is_told_or_its_flights_flown_again(tmp_path, step):
    """Margins of the campaign among the files: the parts have none, the merged campaign has its own."""
    engine = replace(ENGINE, find_stability=lambda campaign, plans: {"runs": campaign.runs})
    keep = "{histories: {flights: [worst 3], rate: 10 Hz}, envelopes: {rate: 2 Hz, channels: [altitude_m]}}"
    campaign, parts = fly_shards(tmp_path, 2, runs="60", keep=keep, execution="{batch: 15}")
    whole = run(campaign, tmp_path / "whole", engine).manifest
    files = [
        path
        for part in parts
        for path in sorted(part.rglob("*"))
        if path.is_file() and path.name != ".lock"
    ]
    chance, again = random.Random(7), []
    for file in files[::step]:
        content = file.read_bytes()
        place = chance.randrange(len(content))
        file.write_bytes(content[:place] + bytes([content[place] ^ 16]) + content[place + 1 :])
        out = tmp_path / "merged"
        try:
            merged = merge_campaign(parts, out, engine)
        except InputError as error:
            assert str(file) in str(error), (file, place)  # noqa: PT017  # others may be flown again
        else:
            again.append(file.parent.name)
            assert merged.complete and merged.manifest.digest == whole.digest, (file, place)
            for name in (*FILES[:3], "margins.json"):
                assert (out / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), (
                    file,
                    place,
                    name,
                )
            assert open_results(out).complete
        file.write_bytes(content)
        shutil.rmtree(out, ignore_errors=True)
    assert set(again) == {"flights", "blocks"}


@pytest.mark.parametrize(
    "fault", [KeyboardInterrupt, OSError(errno.ENOSPC, "No space left on device")]
)
def test_a_merge_that_was_interrupted_goes_on(tmp_path, monkeypatch, fault):
    """'The same command goes on', it said, and then refused: the folder was not empty, or a campaign's."""
    campaign, parts = fly_shards(tmp_path, 2, runs="60", execution="{batch: 15}")
    whole = run(campaign, tmp_path / "whole").manifest
    out = tmp_path / "merged"
    left, copy = 0, shutil.copyfile

    def copy_until(source, target):
        nonlocal left
        left -= 1
        if left == 0:
            raise fault
        copy(source, target)

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
    assert merged.complete and merged.manifest.digest == whole.digest
    for name in FILES[:2]:
        assert (out / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    with pytest.raises(InputError, match="not empty"):
        merge_campaign(parts, tmp_path / "whole", ENGINE)


def test_parts_of_another_version_are_refused_before_anything_is_written(shards, tmp_path):
    _, parts = shards
    with pytest.raises(InputError, match="source"):
        merge_campaign(parts, tmp_path / "merged", replace(ENGINE, source="another"))
    assert not (tmp_path / "merged").exists()


def test_parts_with_another_controller_first_are_refused(tmp_path):
    """The lowest part decided which controller requirements bind."""
    campaign = write_campaign(tmp_path / "f", runs="60")
    turned = write_campaign(tmp_path / "g", runs="60", controllers="{two: two.yaml, one: one.yaml}")
    parts = [tmp_path / "part1", tmp_path / "part2"]
    for i, (file, part) in enumerate(zip((campaign, turned), parts, strict=True), 1):
        run(file, part, shard=(i, 2))
    with pytest.raises(InputError, match="order"):
        merge_campaign(parts, tmp_path / "merged", ENGINE)


def test_plans_travel_from_folder_to_folder(tmp_path):
    campaign, parts = fly_shards(tmp_path, 1)

    def never(*_):
        raise AssertionError("prepared anew")

    request = Request(campaign, tmp_path / "b", shard=(1, 2), plans=parts[0])
    assert run_campaign(request, replace(ENGINE, prepare=never)).complete
    (campaign.parent / "one.yaml").write_text("gain: 3.0\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"another inputs/controllers/one/one\.yaml"):
        run(campaign, tmp_path / "c", plans=parts[0])


@pytest.mark.parametrize("shard", [(4, 3), (1, 301)])
def test_shards_that_cannot_be(tmp_path, shard):
    with pytest.raises(InputError, match="--shard"):
        run(write_campaign(tmp_path / "f"), tmp_path / "out", shard=shard)
    assert not (tmp_path / "out").exists()
