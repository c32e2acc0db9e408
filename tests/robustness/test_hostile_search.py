"""The folder of a search made to harm its reader: refused in words, by every command."""

import json
import shutil
import sys

import pytest
from search.line_flight import LINE, write_line

from abhv_mc.cli.app import main
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.manifest import write_manifest
from abhv_mc.search.rare import RareSettings, find_rare
from abhv_mc.search.search_flights import SearchRequest
from abhv_mc.search.worst import WorstSettings, find_worst

METRIC = "altitude_error_max_m"


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    root = tmp_path_factory.mktemp("searched")
    campaign = write_line(root / "f")
    find_worst(SearchRequest(campaign, root / "worst"), WorstSettings(METRIC, flights=160), LINE)
    find_rare(SearchRequest(campaign, root / "rare"), RareSettings(METRIC, flights=4000), LINE)
    return campaign, root


@pytest.fixture
def abhv_mc(monkeypatch, capfd, tmp_path):
    for place in ("engine", "runner"):
        monkeypatch.setattr(f"abhv_mc.execution.{place}.make_engine", lambda: LINE)
    monkeypatch.setattr("abhv_mc.search.worst.make_engine", lambda: LINE)
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["abhv-mc", *map(str, words)])
        with pytest.raises(SystemExit) as caught:
            main()
        return caught.value.code or 0, "".join(capfd.readouterr())

    return call


def commands(campaign, folder, fly):
    yield "status", folder
    yield "query", folder, "select count(*) from flights"
    yield "report", folder
    yield "verify", "campaign", folder
    yield "replay", folder, "--flight", 3, "--controller", "one"
    yield "run", campaign, "-o", folder, "--no-report"
    if fly and folder.name == "worst":
        yield "worst", campaign, "--metric", METRIC, "-o", folder, "--flights", 160


@pytest.mark.parametrize("kind", ["worst", "rare"])
def test_a_search_deletes_no_flights_that_it_does_not_know(searched, abhv_mc, tmp_path, kind):
    """Neither a campaign's, nor those whose manifest is lost."""
    campaign, _ = searched
    flown = run_campaign(Request(campaign, tmp_path / "flown", runs=40), LINE).folder
    words = ("--metric", METRIC) if kind == "worst" else ("--requirement", METRIC)
    for lost in ((), (flown / "manifest.json",)):
        for path in lost:
            path.unlink()
        held = {path: path.read_bytes() for path in flown.rglob("*.parquet")}
        code, said = abhv_mc(kind, campaign, *words, "-o", flown, "--flights", 2000)
        assert code == 2 and "flights" in said and str(flown) in said, said
        assert {path: path.read_bytes() for path in flown.rglob("*.parquet")} == held


ODD = [5, None, {}, {"kind": 3}, {"kind": "worst"}, {"kind": "rare", "controller": "\x1b]0;t\x07"}]
GONE = ("search", "result", "digest", "controllers", "files", "source_hash", "campaign_hash", "name")
ENTRIES = [
    *({"search": odd} for odd in ODD),
    *({"result": odd} for odd in ODD),
    {"digest": None},
    {"controllers": {}},
    {"controllers": {"two": {"flights_done": 1, "outcomes": {}}}},
    {"seed": 10**30},
    {"runs_planned": 0},
    *(
        {gone: ...}
        for gone in ("search", "result", "digest", "controllers", "files", "source_hash", "campaign_hash", "name")
    ),
]


@pytest.mark.parametrize("kind", ["worst", "rare"])
def test_manifests_of_wrong_entries(searched, abhv_mc, tmp_path, kind):
    campaign, root = searched
    for k, entries in enumerate(ENTRIES):
        folder = shutil.copytree(root / kind, tmp_path / kind)
        manifest = json.loads((folder / "manifest.json").read_text()) | entries
        manifest = {key: value for key, value in manifest.items() if value is not ...}
        for words in commands(campaign, folder, k % 5 == 1):
            write_manifest(folder / "manifest.json", manifest)
            code, said = abhv_mc(*words)
            assert code in (0, 1, 2) and "Traceback" not in said and "\x1b" not in said, (entries, words, said)
        shutil.rmtree(folder)


def test_what_is_in_the_result_is_held_against_the_flights(searched, abhv_mc, tmp_path):
    for kind in ("worst", "rare"):
        folder = shutil.copytree(searched[1] / kind, tmp_path / kind)
        assert abhv_mc("verify", "campaign", folder)[0] == 0
        manifest = json.loads((folder / "manifest.json").read_text())
        for key in ("flight", "flights", "random_flight", "below"):
            for value in (10**9, -1, "x", None):
                if key in manifest["result"]:
                    write_manifest(folder / "manifest.json", manifest | {"result": manifest["result"] | {key: value}})
                    code, said = abhv_mc("verify", "campaign", folder)
                    assert code in (1, 2) and "Traceback" not in said, (kind, key, value, said)
