"""A folder that somebody wrote anew, with hashes and digests that fit: what he changed does not fit the rest."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fake_flight import DENSITY, ENGINE, fly, write_campaign
from report.few_figures import build_with

from abhv_mc.campaign.file.resolve import read_own_campaign, resolve_campaign
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder import envelope_states as collector
from abhv_mc.folder.layout import CampaignFolder, hash_file
from abhv_mc.folder.manifest import write_manifest
from abhv_mc.report.numbers.consistency import find_contradictions
from abhv_mc.report.numbers.results import read_results
from abhv_mc.report.pages.verify import verify_campaign

KEEP = (
    "{histories: {flights: [worst 3, 7], rate: 10 Hz}, envelopes: {rate: 5 Hz, channels: [altitude_m, sideslip_deg]}}"
)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    requirements = "[{metric: altitude_error_max_m, below: 1.6, probability: 0.9, controllers: [one, two]}]"
    campaign = write_campaign(root / "f", runs="60", keep=KEEP, requirements=requirements, execution="{batch: 20}")
    folder = run_campaign(Request(campaign, root / "out"), ENGINE).folder
    build_with(folder)
    return folder


@pytest.fixture
def folder(flown, tmp_path):
    return shutil.copytree(flown, tmp_path / "out")


def forge(folder, **entries):
    """The hashes of all files as they are now, and entries of the manifest; what does not fit then."""
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    manifest["files"] = {name: hash_file(folder / name) for name in manifest["files"] if (folder / name).is_file()}
    manifest["inputs"] = {name: hash_file(folder / name) for name in manifest["inputs"]}
    write_manifest(folder / "manifest.json", manifest | entries)
    return list(find_contradictions(read_results(folder)))


def change(path, column, alter):
    """Rewrite a column of a table; what its file says of itself stays."""
    table = pq.read_table(path, partitioning=None)
    place = table.column_names.index(column)
    values = pa.array(alter(table[column].to_numpy().copy()))
    pq.write_table(table.set_column(place, table.schema.field(place), values), path)


def shifted(values):
    return values + np.asarray(1.0, values.dtype)


def test_an_untouched_folder_fits_and_verify_looks(flown, folder):
    assert list(verify_campaign(flown)) == []
    forge(folder, runs_failed=1)
    assert "manifest.runs_failed: 1 in the manifest, 0 from the data" in verify_campaign(folder)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("probability: 0.9", "probability: 0.5", "manifest.requirements"),
        ("below: 1.6", "below: 9.6", "manifest.requirements"),
        ("seed: 5", "seed: 6", "samples.parquet: not what the campaign's seed"),
        ("half_width: 10 %", "half_width: 9 %", "samples.parquet: not what the campaign's seed"),
        ("question: ''", "question: other", "campaign_hash"),
        ("worst 3", "worst 2", "histories/one-000000.parquet: other flights"),
        ("rate: 5 Hz", "rate: 4 Hz", "envelopes.parquet: altitude_m of one: times"),
        ("sideslip_deg", "bank_deg", "envelopes.parquet: other controllers or channels"),
    ],
)
def test_another_campaign_file(folder, before, after, words):
    """Its own hash does not fit; where that was made anew as well, the data still do not."""
    path = folder / "campaign.yaml"
    text = path.read_text(encoding="utf-8")
    if before.startswith("question"):
        before, after = "name: fake", "name: fake\nquestion: another"
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")
    found = forge(folder)
    assert any("campaign_hash" in line for line in found), found
    identity = resolve_campaign(read_own_campaign(CampaignFolder(folder))).identity
    found = forge(folder, campaign_hash=identity, seed=6 if "seed" in after else 5)
    assert "question" in after or any(words in line for line in found), found


def test_another_input(folder):
    (folder / "inputs/controllers/one/one.yaml").write_text("gain: 3.0\n", encoding="utf-8")
    assert any("campaign_hash" in line for line in forge(folder))


@pytest.mark.parametrize(
    "entries",
    [
        {"name": "another"},
        {"seed": 7},
        {"runs_planned": 61},
        {"runs_done": 59},
        {"runs_failed": 1},
        {"digest": "0" * 64},
        {"digests": {}},
        {"controllers": {}},
        {"requirements": []},
    ],
)
def test_another_entry_of_the_manifest(folder, entries):
    (key,) = entries
    found = forge(folder, **entries)
    assert any(line.startswith(f"manifest.{key}") for line in found), found


def test_another_verdict(folder):
    requirements = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["requirements"]
    found = forge(folder, requirements=[requirements[0] | {"verdict": "PASS", "failures": 0}, *requirements[1:]])
    assert any(line.startswith("manifest.requirements[0].failures") for line in found)


def test_a_block_of_other_flights_or_missing(folder):
    block, strange = (
        folder / f"flights/{flights}.parquet" for flights in ("one-000000000-000000020", "three-000000000-000000020")
    )
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    files = {name: known for name, known in manifest["files"].items() if name != f"flights/{block.name}"}
    block.rename(strange)
    change(strange, "controller", lambda v: np.full(len(v), "three"))
    found = forge(folder, files=files | {f"flights/{strange.name}": hash_file(strange)})
    assert found[0] == f"flights/{strange.name}: belongs to no part of this campaign"
    strange.unlink()
    found = forge(folder, files=files)
    assert any(line.startswith("manifest.controllers.one.flights_done: 60 in the manifest, 40") for line in found)


@pytest.mark.parametrize(
    ("column", "alter", "words"),
    [
        ("sideslip_deg", lambda v: v * np.float32(1.5), "but its sideslip_max_deg is"),
        ("angle_of_attack_deg", lambda v: v - np.float32(3.0), "but its angle_of_attack_min_deg is"),
        ("cross_track_m", lambda v: v * np.float32(0.5), "but its cross_track_error_final_m is"),
        ("altitude_m", lambda v: v + np.float32(9.0), "altitude_m leaves the envelope"),
        ("time", shifted, "times that are not 10 a second"),
        ("flight", shifted, "other flights than the campaign keeps"),
    ],
)
def test_another_history(folder, column, alter, words):
    change(folder / "histories/one-000000.parquet", column, alter)
    assert any(words in line for line in forge(folder))


def test_a_history_that_is_cut_short_of_another_controller_or_not_asked_for(folder):
    path, other = (folder / f"histories/{name}-000000.parquet" for name in ("one", "two"))
    table = pq.read_table(path, partitioning=None)
    pq.write_table(table.filter(pa.compute.less(table["time"], 0.65)), path)
    assert any("ends at 0.6 s, but the flight at " in line for line in forge(folder))
    shutil.copyfile(other, path)
    assert any("other flights than the campaign keeps of one" in line for line in forge(folder))
    path.unlink()
    assert any("histories/one-000000.parquet: missing" in line for line in forge(folder))


@pytest.mark.parametrize(
    ("column", "alter", "words"),
    [
        ("max", lambda v: v * 5.0, "but sideslip_max_deg of the flights is"),
        ("max", lambda v: v * 0.9, "leaves the envelope of all flights"),
        ("count", lambda v: v - 1, "other numbers of flights still flying"),
        ("time", lambda v: v * 2.0, "times that are not 5 a second"),
    ],
)
def test_other_envelopes(folder, column, alter, words):
    change(folder / "envelopes.parquet", column, alter)
    found = forge(folder)
    assert any(words in line for line in found), found


def test_a_folder_that_says_it_is_older_is_only_half_checked_and_told_so(folder, capsys):
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    write_manifest(folder / "manifest.json", {key: value for key, value in manifest.items() if key != "files"})
    assert list(find_contradictions(read_results(folder))) == []
    assert "written by an older version" in capsys.readouterr().err


LAW = "{distribution: uniform, half_width: 2 %}"
THREE = f"{{atmosphere.density: {LAW}, aero.lift: {LAW}, aero.drag: {LAW}}}"
VARIANTS = {
    "lhs": {"sampling": "lhs"},
    "sobol": {"sampling": "sobol", "runs": "64"},
    "corners": {"sampling": "corners", "runs": "4", "keep": "{histories: {flights: all}}"},
    "saltelli": {"sampling": "saltelli", "runs": "80", "dispersions": THREE},
    "all histories at another rate": {"keep": "{histories: {flights: all, rate: 2 Hz}, envelopes: {rate: 10 Hz}}"},
    "no histories": {"keep": "{histories: {flights: none}, envelopes: {rate: 1 Hz, channels: all}}"},
    "failed ones and some channels": {"keep": "{histories: {flights: [failed, every 7], channels: [mass_kg]}}"},
    "when proven": {"stop": "when proven", "runs": "900", "keep": "{histories: {flights: [worst 2, 899]}}"},
    "as measured": {
        "requirements": "[{metric: sideslip_max_deg, above: 0.1, probability: 0.5, ended_early: as_measured}]",
        "family": "{method: holm, risk: 0.1}",
    },
    "no requirement": {"requirements": "[]", "correlations": "[{between: [atmosphere.density, aero.lift], rank: 0.5}]"},
    "own metric": {"metrics": "{}", "controllers": "{one: one.yaml}"},
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_campaigns_of_all_kinds_fit(tmp_path, variant):
    entries = {"runs": "60", "execution": "{batch: 20}", **VARIANTS[variant]}
    result = run_campaign(Request(write_campaign(tmp_path / "f", **entries), tmp_path / "out"), ENGINE)
    assert result.complete and list(find_contradictions(read_results(result.folder))) == []


def test_a_campaign_that_grew_and_got_a_controller_fits(tmp_path):
    campaign = write_campaign(tmp_path / "f", runs="40")
    for more in ({"controllers": ("two",)}, {}, {"runs": 70}):
        folder = run_campaign(Request(campaign, tmp_path / "out", **more), ENGINE).folder
        assert list(find_contradictions(read_results(folder))) == [], more


def test_merged_shards_fit(tmp_path):
    campaign = write_campaign(tmp_path / "f", runs="40")
    parts = [run_campaign(Request(campaign, tmp_path / f"p{i}", shard=(i, 2)), ENGINE).folder for i in (1, 2)]
    folder = merge_campaign(parts, tmp_path / "merged", ENGINE).folder
    assert list(find_contradictions(read_results(folder))) == []


def test_a_campaign_of_many_flights_fits(tmp_path, monkeypatch):
    """Whose envelopes are histograms."""
    monkeypatch.setattr(collector, "EXACT_FLIGHTS", 0)
    folder = run_campaign(Request(write_campaign(tmp_path / "f", runs="300"), tmp_path / "out"), ENGINE).folder
    assert list(find_contradictions(read_results(folder))) == []


def fly_but_some(plan, parameters, record_every=None):
    """Flights of much density cannot be computed."""
    block = fly(plan, parameters, record_every)
    lost = parameters[:, DENSITY] > 1.095
    block.outcome[lost], block.metrics[lost], block.history[lost] = Outcome.FAILED_TO_RUN, np.nan, np.nan
    return block


def test_flights_that_could_not_be_computed_fit(tmp_path):
    campaign = write_campaign(tmp_path / "f", runs="60", execution="{batch: 20}")
    for engine, failed in ((replace(ENGINE, fly=fly_but_some), True), (ENGINE, False)):  # then they can be
        result = run_campaign(Request(campaign, tmp_path / "out"), engine)
        assert (result.manifest["runs_failed"] > 0) == failed
        assert list(find_contradictions(read_results(result.folder))) == []
