"""Small files of flights become few, with the same rows and digest, whatever moment the process is killed at."""

import dataclasses
from itertools import count
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, fly, run, write_campaign

from abhv_mc.analysis.replay import find_rows
from abhv_mc.execution import runner
from abhv_mc.folder import flown_blocks
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.layout import CampaignFolder


class KilledError(BaseException):
    """The process is no more: nothing is written from then on."""


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """One whose 300 flights of a controller are five files, and three when they are joined."""
    monkeypatch.setattr(flown_blocks, "_GROUP", 100)
    file = write_campaign(tmp_path / "f", controllers="{one: one.yaml}")
    whole = run(file, tmp_path / "whole").manifest
    monkeypatch.setattr(flown_blocks, "MANY", 2)
    monkeypatch.setattr(flown_blocks, "ROWS", 192)
    return file, whole


def names(out):
    return sorted(path.name for path in (out / "flights").glob("*.parquet"))


def test_rows_digest_resume_and_growth_are_as_before(campaign, tmp_path, capfd):
    file, whole = campaign
    out = tmp_path / "out"
    joined = run(file, out).manifest
    assert names(out) == ["one-000000000-000000192.parquet", "one-000000192-000000300.parquet"]
    assert [name for name in joined.files if "flights" in name] == [f"flights/{name}" for name in names(out)]
    assert joined.digest == whole.digest and len(names(tmp_path / "whole")) == 5
    one, other = (pq.read_table(place / "flights").sort_by("flight") for place in (out, tmp_path / "whole"))
    assert one.equals(other)
    assert [row.first for row in find_rows(CampaignFolder(out), "one", [150])] == [150]
    flown = [read_flown(place).flights["one"] for place in (out, tmp_path / "whole")]
    assert flown[0].flight.tolist() == flown[1].flight.tolist() == list(range(300))

    def refuse(*_):
        raise AssertionError("flown again")

    assert run(file, out, dataclasses.replace(ENGINE, fly=refuse)).complete  # nothing to fly
    longer = run(file, out, runs=600).manifest
    assert longer.digest == run(file, tmp_path / "new", runs=600).manifest.digest
    (out / "flights" / names(out)[1]).write_bytes(b"rot")
    assert run(file, out, runs=600).manifest.digest == longer.digest


def test_a_kill_at_any_step_loses_nothing(campaign, tmp_path, monkeypatch, capfd):
    """Before and after each file, the manifest and each deletion; no flight is flown again."""
    file, whole = campaign
    last, dead, joining, flown = -1, False, False, 0

    def step(function, *arguments, **more):
        nonlocal dead
        if dead or (joining and next(steps) == last):
            dead = True
            raise KilledError
        return function(*arguments, **more)

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
    for owner, name in ((flown_blocks, "write_rows"), (runner, "write_manifest"), (Path, "unlink")):
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
        assert (done.state, done.digest, flown) == ("complete", whole.digest, 5)
        assert len(names(out)) == 2
    assert killed == 2 + 1 + 5  # two files, the manifest, five deletions
