"""Entries of the manifest: workers of flights, and events of simulators."""

import json
from dataclasses import replace

import pytest

from abhv_mc.folder.manifest import (
    FORMAT,
    Manifest,
    add_events,
    hash_entries,
    join_flyers,
    note_flyers,
    read_manifest,
    shift_flyers,
    write_manifest,
)
from abhv_mc.identity import this_flyer
from abhv_mc.io.messages import InputError


def test_flights_belong_to_their_last_worker():
    first, second = this_flyer(), this_flyer()._replace(host="node7")
    entries = note_flyers([], (first,), "one", 0, 64)
    entries = note_flyers(entries, (first._replace(process=1),), "one", 64, 128)
    entries = note_flyers(entries, (second,), "one", 32, 96)
    assert [(entry.host, entry.blocks["one"]) for entry in entries] == [
        (first.host, ((0, 32), (96, 128))),
        ("node7", ((32, 96),)),
    ]
    joined = join_flyers([*entries, *note_flyers([], (second,), "one", 128, 160)])
    assert [entry.blocks["one"] for entry in joined] == [
        ((0, 32), (96, 128)),
        ((32, 96), (128, 160)),
    ]
    entry, *_ = note_flyers(joined, (second,), "one", 0, 16)
    assert entry.blocks["one"] == ((16, 32), (96, 128))
    assert note_flyers(joined, (first,), "one", 0, 160)[0].blocks == {"one": ((0, 160),)}
    mixed = note_flyers(note_flyers([], (first,), "one", 0, 64), (first,), "two", 0, 64)
    moved = note_flyers(join_flyers(mixed), (second,), "two", 0, 64)
    assert [(entry.host, dict(entry.blocks)) for entry in moved] == [
        (first.host, {"one": ((0, 64),), "two": ()}),
        ("node7", {"two": ((0, 64),)}),
    ]
    shifted, _ = shift_flyers(joined, 10)
    assert shifted == replace(joined[0], blocks={"one": ((10, 42), (106, 138))})


def test_events_of_simulators_are_added_by_system():
    first, second = {"one": {"surplus": 1}, "two": {}}, {"one": {"surplus": 2, "restarts": 1}}
    total = {"one": {"surplus": 3, "restarts": 1}, "two": {}}
    assert add_events([first, None, second]) == total and add_events([None]) is None


def with_hash(entries):
    content = {key: value for key, value in entries.items() if key != "manifest_hash"}
    return content | {"manifest_hash": hash_entries(content)}


def test_other_formats_and_damaged_manifests_are_refused(tmp_path):
    path = tmp_path / "manifest.json"
    manifest = Manifest(name="x", state="complete", seed=1, campaign_hash="c", source_hash="s")
    write_manifest(path, manifest)
    assert read_manifest(path) == manifest
    entries = json.loads(path.read_text("utf-8"))
    for content, problem in (
        (entries | {"format": FORMAT - 1}, f"format {FORMAT - 1}"),
        ({key: entries[key] for key in entries if key != "format"}, "number is missing"),
        ([entries], "number is missing"),
        (with_hash(entries | {"seed": "x", "state": 3}), "invalid entry 'state'"),
        (with_hash(entries | {"shard": [1, "x"]}), r"invalid entry 'shard\.1'"),
        (entries | {"seed": 2}, "hash differs"),
        ("{", "damaged"),
    ):
        path.write_text(content if content == "{" else json.dumps(content), "utf-8")
        with pytest.raises(InputError, match=problem):
            read_manifest(path)
    for missing, problem in ((path / "manifest.json", "is a file"), (tmp_path / "x", "no such")):
        with pytest.raises(InputError, match=problem):
            read_manifest(missing)
