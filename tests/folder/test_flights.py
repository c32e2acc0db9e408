"""Tests of the files of flights: merging of small files, kills in between, and the digest."""

import dataclasses
from itertools import count
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, fly, run, write_campaign

from abhv_mc.analysis.replay import find_rows
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution import runner
from abhv_mc.flights.parameters import Parameter
from abhv_mc.folder import flown_blocks, hashes
from abhv_mc.folder.flights import (
    INPUT,
    DamagedFileError,
    Digest,
    SampleReader,
    block_path,
    digest_rows,
    make_input_field,
    read_pieces,
    write_inputs,
)
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.layout import CampaignFolder, find_in_campaign


class KilledError(BaseException):
    """Simulated kill of the process, after which nothing is written."""


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """Campaign whose 300 flights of a controller are in five files, and merged in two."""
    monkeypatch.setattr(flown_blocks, "_GROUP", 100)
    file = write_campaign(tmp_path / "f", controllers="{one: one.yaml}")
    uninterrupted = run(file, tmp_path / "whole").manifest
    monkeypatch.setattr(flown_blocks, "MANY", 2)
    monkeypatch.setattr(flown_blocks, "ROWS", 192)
    return file, uninterrupted


def names(out):
    return sorted(path.name for path in (out / "flights").glob("*.parquet"))


def test_rows_digest_resume_and_growth_are_as_before(campaign, tmp_path, capfd):
    file, unmerged = campaign
    out = tmp_path / "out"
    merged = run(file, out).manifest
    assert names(out) == ["one-000000000-000000192.parquet", "one-000000192-000000300.parquet"]
    assert [name for name in merged.files if "flights" in name] == [
        f"flights/{name}" for name in names(out)
    ]
    assert merged.digest == unmerged.digest and len(names(tmp_path / "whole")) == 5
    table, unmerged_table = (
        pq.read_table(folder / "flights").sort_by("flight") for folder in (out, tmp_path / "whole")
    )
    assert table.equals(unmerged_table)
    assert [row.first for row in find_rows(CampaignFolder(out), "one", [150])] == [150]
    flights = [read_flown(folder).flights["one"] for folder in (out, tmp_path / "whole")]
    assert flights[0].flight.tolist() == flights[1].flight.tolist() == list(range(300))

    path = out / "flights" / names(out)[0]  # two groups of 128 and 64 flights
    for is_intact in (False, True):
        rows, digests = zip(*read_pieces(path, ("aero.lift",), is_intact=is_intact), strict=True)
        assert [(piece.first, piece.stop) for piece in rows] == [(0, 128), (128, 192)]
        assert sum(digests, Digest()) == sum((piece.digest() for piece in rows), Digest())
    for name in ("one-000000001-000000193.parquet", "one-000000000-000000200.parquet"):
        with pytest.raises(DamagedFileError):
            [*read_pieces(path.rename(path.with_name(name)), ("aero.lift",), is_intact=True)]
        path.with_name(name).rename(path)

    def refuse(*_):
        raise AssertionError("run again")

    assert run(file, out, dataclasses.replace(ENGINE, fly=refuse)).complete  # nothing to run
    longer = run(file, out, runs=600).manifest
    assert longer.digest == run(file, tmp_path / "new", runs=600).manifest.digest
    (out / "flights" / names(out)[1]).write_bytes(b"rot")
    assert run(file, out, runs=600).manifest.digest == longer.digest


def test_a_kill_at_any_step_loses_nothing(campaign, tmp_path, monkeypatch, capfd):
    """Kill before each file, the manifest and each deletion; no flight is run again."""
    file, uninterrupted = campaign
    last, dead, joining, flown = -1, False, False, 0

    def step(function, *arguments, **keywords):
        nonlocal dead
        if dead or (joining and next(steps) == last):
            dead = True
            raise KilledError
        return function(*arguments, **keywords)

    def join(self, join=runner._Run._join_files):
        nonlocal joining
        joining = True
        join(self)
        joining = False

    def write(*arguments, write=runner.write_block):
        nonlocal flown
        flown += 1
        return write(*arguments)

    monkeypatch.setattr(runner._Run, "_join_files", join)
    monkeypatch.setattr(runner, "write_block", write)
    for owner, name in ((flown_blocks, "write_rows"), (hashes, "write_manifest"), (Path, "unlink")):
        function = getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda *a, function=function, **k: step(function, *a, **k))
    for killed in count():
        out, last, steps, flown = tmp_path / f"out{killed}", killed, count(), 0
        try:
            run(file, out, dataclasses.replace(ENGINE, fly=fly))
            break
        except KilledError:
            joining, dead, last = False, False, -1
        assert flown == 5
        done = run(file, out).manifest
        assert (done.state, done.digest, flown) == ("complete", uninterrupted.digest, 5)
        assert len(names(out)) == 2
    assert killed == 2 + 1 + 5  # two files, the manifest, five deletions


PINNED = "9ded2633bb5c1b63ebc72da123c64739e0929e640e665c1945754b5a797da0b3"
FLIGHTS = np.arange(50)
OUTCOME = tuple("ok" if i % 7 else "sideslip_limit" for i in range(50))
COLUMNS = dict(zip("bac", np.random.default_rng(0).normal(size=(3, 50)), strict=True))


def digest(rows=slice(None), controller="tlc", flights=FLIGHTS, outcome=OUTCOME, columns=COLUMNS):
    ends = tuple(np.array(outcome)[rows].tolist())
    return digest_rows(
        controller, flights[rows], ends, {name: value[rows] for name, value in columns.items()}
    )


def test_the_digest_ignores_the_order_of_rows_and_columns_and_the_bits_of_nan():
    parts = [digest(slice(a, b)) for a, b in ((30, 50), (0, 1), (1, 30))]
    assert sum(parts, Digest()) == digest() == digest(columns=dict(sorted(COLUMNS.items())))
    assert digest(outcome=("failed_to_run", *OUTCOME[1:])) == digest(slice(1, None))
    signs = [
        COLUMNS | {"a": np.where(FLIGHTS == 3, sign * np.nan, COLUMNS["a"])} for sign in (1, -1)
    ]
    assert digest(columns=signs[0]) == digest(columns=signs[1])


def test_the_digest_depends_on_every_bit():
    values = COLUMNS["a"].copy()
    values[17] = np.nextafter(values[17], 9.0)
    changes = (
        {"columns": COLUMNS | {"a": values}},
        {"controller": "lqr"},
        {"flights": FLIGHTS + 1},
        {"outcome": ("ok",) * 50},
        {"columns": {"z" if name == "c" else name: value for name, value in COLUMNS.items()}},
        {"columns": COLUMNS | {"a": COLUMNS["b"], "b": COLUMNS["a"]}},
    )
    assert len({digest(), *(digest(**change) for change in changes)}) == 7


def test_the_digest_of_a_row_is_pinned():
    """A change would make the digests of stored campaigns meaningless."""
    stored = digest_rows(
        "tlc", np.array([3]), ("ok",), {"aero.lift": np.array([1.0]), "x_m": np.array([2.5])}
    )
    assert str(stored) == PINNED


def test_the_table_of_inputs_has_the_samples_with_units(tmp_path):
    laws = "{aero.drag: {distribution: normal, sigma: 5 %}, "
    laws += "initial.altitude: {distribution: normal, sigma: 30 m}}"
    campaign = read_campaign(write_campaign(tmp_path / "f", dispersions=laws, runs="70"))
    assert write_inputs(campaign, tmp_path / "inputs.csv") == 70
    table = pd.read_csv(tmp_path / "inputs.csv")
    assert [*table] == ["flight", "aero.drag", "initial.altitude [m]"]
    drawn = np.column_stack([np.arange(70), campaign.make_samples().draw(0, 70)])
    np.testing.assert_array_equal(table, drawn)


def test_joining_detects_any_changed_bit(tmp_path):
    """Parquet's checksums are written and read; compressed floats would be read without them."""
    out = run(
        write_campaign(tmp_path / "f", controllers="{one: one.yaml}"), tmp_path / "out"
    ).folder
    paths = sorted((out / "flights").glob("*.parquet"))[:2]
    joined = flown_blocks.join_files(paths)
    expected = pq.read_table(joined)
    joined.unlink()
    content, draw = paths[0].read_bytes(), np.random.default_rng(1)
    detected, footer = 0, len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    for position in draw.integers(4, footer, 100).tolist():
        changed = bytearray(content)
        changed[position] ^= 1 << int(draw.integers(8))
        paths[0].write_bytes(changed)
        try:
            table = pq.read_table(flown_blocks.join_files(paths))
        except (OSError, pa.ArrowInvalid, DamagedFileError):
            detected += 1
        else:
            assert table.equals(expected), position
    assert detected > 50


def test_rows_across_groups_are_read_with_the_group_before(tmp_path, monkeypatch):
    monkeypatch.setattr("abhv_mc.folder.flights.ROW_GROUP", 64)
    campaign = write_campaign(tmp_path / "f", controllers="{one: one.yaml}")
    samples = CampaignFolder(run(campaign, tmp_path / "out").folder).samples
    expected = pq.read_table(samples).drop_columns("flight").to_pandas().to_numpy()
    reader = SampleReader(samples)
    for first, stop in ((0, 64), (60, 70), (130, 300), (128, 129), (64, 130)):
        assert np.array_equal(reader.rows(first, stop), expected[first:stop])
    assert len(reader._groups) <= 2  # a campaign of a million flights fits into memory
    assert set(reader._groups) == {1, 2}
    assert reader.agrees(lambda first, stop: expected[first:stop])
    for odd in (0, 130):  # in one group of several
        assert not reader.agrees(
            lambda first, stop, odd=odd: expected[first:stop] + (first <= odd < stop)
        )


@pytest.mark.parametrize(("name", "marked"), [("aero.lift", False), ("mass", True)])
def test_inputs_without_a_dot_are_marked_so_that_they_are_no_metrics(name, marked):
    parameter = Parameter(name, "kg", 1.0, "input")
    assert (INPUT in make_input_field(parameter).metadata) is marked


def test_a_path_is_in_a_campaign_only_below_its_own_files(tmp_path):
    out = run(write_campaign(tmp_path / "f", runs="40"), tmp_path / "out").folder
    inside = {out: ".", out / "flights/x": "flights/x", out / "manifest.json": "manifest.json"}
    assert {path: str(find_in_campaign(path)) for path in inside} == inside
    for outside in (tmp_path, tmp_path / "flights/x", out / "notes/mine.txt"):
        assert find_in_campaign(outside) is None


def test_adjacent_files_of_a_controller_with_many_are_joined(tmp_path, monkeypatch):
    monkeypatch.setattr(flown_blocks, "MANY", 3)
    monkeypatch.setattr(flown_blocks, "ROWS", 100)

    def paths(name, *ranges):
        return [block_path(tmp_path, name, *ends) for ends in ranges]

    few = paths("few", (0, 40), (40, 80), (80, 120))
    many = paths("a-b", (0, 40), (40, 100), (100, 101), (110, 120), (120, 210), (210, 211))
    assert flown_blocks.find_joins([*many[::-1], *few]) == [many[:2], many[3:5]]
