"""Two runs, searches or merges in one new folder: the second is rejected at any moment."""

from contextlib import contextmanager
from dataclasses import replace

import pytest
from fake_flight import ENGINE, interrupted_after, run, write_campaign
from search.known_flights import LINE, METRIC, write_line

from abhv_mc.execution.merge import merge_campaign
from abhv_mc.folder import merge
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.layout import recording
from abhv_mc.io.messages import InputError
from abhv_mc.requests import WorstRequest
from abhv_mc.search.worst import find_worst

KEEP = "{histories: {flights: [worst 5], rate: 10 Hz}, envelopes: {rate: 5 Hz}}"


@contextmanager
def at_each_file(start, files):
    """Call ``start`` after each file that is written, which is noted in ``files``."""
    is_starting = False

    def note(path, _):
        nonlocal is_starting
        assert not is_starting, f"the second run wrote {path}"
        files.append(path.name)
        is_starting = True
        start()
        is_starting = False

    with recording(note):
        yield


def expect_rejected(start):
    """A function that expects ``start`` to be rejected because another process has the folder."""

    def call():
        with pytest.raises(InputError, match=r"process \d+ on"):
            start()

    return call


@pytest.fixture(autouse=True)
def no_patience(monkeypatch):
    """Reject at once: the first process holds its lock until the second is rejected."""
    monkeypatch.setattr("abhv_mc.folder.lock._PATIENCE", 0.0)


@pytest.fixture
def campaign(tmp_path):
    return write_campaign(tmp_path / "inputs", runs="64", keep=KEEP)


@pytest.mark.parametrize("fresh", [False, True])
def test_a_second_run_is_rejected_at_each_file_of_the_first(campaign, tmp_path, fresh):
    alone = run(campaign, tmp_path / "alone", seed=1).manifest
    out, files = tmp_path / "out", []
    if fresh:
        run(campaign, out, seed=3)
    second = expect_rejected(lambda: run(campaign, out, seed=2, fresh=fresh))

    def prepare(*names):
        second()
        return ENGINE.prepare(*names)

    with at_each_file(second, files):
        first = run(campaign, out, replace(ENGINE, prepare=prepare), seed=1, fresh=fresh)
    assert first.complete and first.manifest.digest == alone.digest
    assert {"campaign.yaml", "samples.parquet", "manifest.json", "envelopes.parquet"} <= set(files)
    read_flown(out)


def test_a_second_search_is_rejected_at_each_file_of_the_first(tmp_path):
    out, files = tmp_path / "out", []

    line = write_line(tmp_path / "files")

    def search(seed):
        find_worst(WorstRequest(line, out, METRIC, seed=seed, flights=200), LINE)

    with at_each_file(expect_rejected(lambda: search(2)), files):
        search(1)
    assert "manifest.json" in files


def test_a_second_merge_is_rejected_at_each_file_of_the_first(campaign, tmp_path):
    parts = [run(campaign, tmp_path / f"{i}", shard=(i, 2)).folder for i in (1, 2)]
    out, files = tmp_path / "out", []
    reference = run(campaign, tmp_path / "whole").manifest
    second = expect_rejected(lambda: merge_campaign(parts, out, ENGINE))
    with at_each_file(second, files):
        merged = merge_campaign(parts, out, ENGINE)
    assert merged.manifest.digest == reference.digest and "manifest.json" in files


def test_a_run_during_the_checks_of_a_merge_keeps_its_flights(campaign, tmp_path, monkeypatch):
    """A merge must not delete flights computed between its check and its lock."""
    parts = [run(campaign, tmp_path / f"{i}", shard=(i, 2)).folder for i in (1, 2)]
    out = tmp_path / "out"
    check = merge._check_content

    def check_while_another_run_starts(*arguments):
        check(*arguments)
        with pytest.raises(InputError, match=r"process \d+ on"):
            run(campaign, out, seed=7)

    monkeypatch.setattr(merge, "_check_content", check_while_another_run_starts)
    assert merge_campaign(parts, out, ENGINE).complete


def test_a_rejected_campaign_leaves_no_folder(campaign, tmp_path):
    out = tmp_path / "new" / "out"
    refused = replace(ENGINE, prepare=lambda *_: _raise(InputError("x", "no plan", "one")))
    for make_empty in (False, True):
        if make_empty:
            out.mkdir(parents=True)
        with pytest.raises(InputError, match="no plan"):
            run(campaign, out, refused)
        assert out.exists() == make_empty and (tmp_path / "new").exists() == make_empty
    assert not list(out.iterdir())


def _raise(error):
    raise error


def test_fresh_deletes_nothing_for_a_rejected_campaign(campaign, tmp_path):
    out = run(campaign, tmp_path / "out", interrupted_after(5)).folder
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    refused = replace(ENGINE, prepare=lambda *_: _raise(InputError("x", "no plan", "one")))
    with pytest.raises(InputError, match="no plan"):
        run(campaign, out, refused, fresh=True)
    (campaign.parent / "two.yaml").write_text("nothing\n")
    with pytest.raises(InputError, match=r"two\.yaml"):
        run(campaign, out, fresh=True)
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
