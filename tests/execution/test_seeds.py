"""Campaigns that differ only in their seed are pooled as flights of one campaign."""

import html
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, interrupted_after, run, write_campaign
from fake_flight import fly as fly_fake

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.merge import suggest_merge
from abhv_mc.identity import code_hash
from abhv_mc.io.messages import InputError
from abhv_mc.report.pages.build import is_up_to_date
from abhv_mc.requests import Request
from abhv_mc.statistics.verdicts import judge, verdict_words
from abhv_mc.topics.verdicts.model import compute_verdicts

# About 4 % of the fake flights end early.
ASKED = "[{metric: altitude_error_max_m, below: 50, probability: 0.93}]"


def fly(tmp_path, seeds, **entries):
    campaign = write_campaign(tmp_path / "f", **{"requirements": ASKED, "runs": "200", **entries})
    return campaign, [run(campaign, tmp_path / f"seed{s}", seed=s).manifest for s in seeds]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Return the folder of campaigns with three seeds, which no test changes, and manifests."""
    folder = tmp_path_factory.mktemp("seeds")
    return folder, fly(folder, (1, 2, 3))[1]


def test_a_merge_is_judged_by_all_counts(flown, tmp_path):
    folder, parts = flown
    merged = merge_campaign([folder / f"seed{s}" for s in (1, 2, 3)], tmp_path / "all", ENGINE)
    (entry,) = merged.manifest.requirements
    assert merged.complete and entry.flights == 600
    assert entry.failures == sum(manifest.requirements[0].failures for manifest in parts)
    verdict = judge(entry.failures, 600, 0.93, entry.consumer_risk)
    assert (entry.verdict, entry.words) == (verdict.status, verdict_words(verdict))
    assert merged.manifest.question == parts[0].question
    computed = compute_verdicts(read_flown(tmp_path / "all")).requirements[0].controllers["one"]
    assert (computed.flights, computed.failures, computed.status) == (
        600,
        entry.failures,
        entry.verdict,
    )


def test_a_merge_lists_the_workers_of_all_flights(tmp_path):
    engine = replace(ENGINE, source=code_hash(), checked=True)
    campaign = write_campaign(tmp_path / "f", runs="40", keep="{}")
    folders = [run(campaign, tmp_path / str(s), engine, seed=s).folder for s in (1, 2)]
    (entry,) = merge_campaign(folders, tmp_path / "all", engine).manifest.flown_by
    assert entry.blocks == {"one": ((0, 80),), "two": ((0, 80),)}


def fly_otherwise(plan, parameters, every=None):
    block = fly_fake(plan, parameters, every)
    return replace(block, metrics=block.metrics + 1.0)


def test_each_flight_keeps_its_seed_and_number(flown, tmp_path):
    """Stored rows are renumbered; flights are run again for their envelopes alone."""
    folder, _ = flown
    engine = replace(ENGINE, fly=fly_otherwise)
    merge_campaign([folder / "seed1", folder / "seed3"], tmp_path / "all", engine)
    samples = pq.read_table(tmp_path / "all/samples.parquet").drop_columns("flight")
    for number, seed in enumerate((1, 3)):
        own = pq.read_table(folder / f"seed{seed}/samples.parquet").drop_columns("flight")
        assert samples.slice(200 * number, 200).equals(own)
        flights = pq.read_table(tmp_path / "all/flights", filters=[("controller", "=", "two")])
        rows = pq.read_table(folder / f"seed{seed}/flights", filters=[("controller", "=", "two")])
        ours = np.array(flights.sort_by("flight")["altitude_error_max_m"])[
            200 * number : 200 * number + 200
        ]
        assert np.array_equal(
            ours, np.array(rows.sort_by("flight")["altitude_error_max_m"]), equal_nan=True
        )
    pooled = read_campaign(tmp_path / "all/campaign.yaml").model.pooled
    assert [(campaign.seed, campaign.runs) for campaign in pooled] == [(1, 200), (3, 200)]
    assert max(pq.read_table(tmp_path / "all/envelopes.parquet")["count"].to_pylist()) == 400


def test_a_merge_resumes_and_can_be_merged_and_extended(flown, tmp_path):
    first = [flown[0] / "seed1", flown[0] / "seed2"]
    digest = merge_campaign(first, tmp_path / "two", ENGINE).manifest.digest
    assert merge_campaign(first, tmp_path / "two", ENGINE).manifest.digest == digest
    three = merge_campaign([tmp_path / "two", flown[0] / "seed3"], tmp_path / "three", ENGINE)
    assert three.manifest.requirements[0].flights == 600
    longer = run(tmp_path / "three/campaign.yaml", tmp_path / "three", runs=650)
    assert longer.complete and longer.manifest.requirements[0].flights == 650


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        (dict(seed=1), "seed 1"),
        (dict(campaign=dict(requirements=ASKED.replace("50", "51"))), "below 50 -> 51"),
        (dict(campaign=dict(sampling="lhs")), "campaign differs"),
        (dict(engine=replace(ENGINE, source="other")), "source hash"),
    ],
)
def test_incompatible_seeds_are_rejected(flown, tmp_path, change, pattern):
    campaign = write_campaign(
        tmp_path / "g", **{"requirements": ASKED, "runs": "200", **change.get("campaign", {})}
    )
    other = Request(campaign, tmp_path / "other", seed=change.get("seed", 2))
    run_campaign(other, change.get("engine", ENGINE))
    with pytest.raises(InputError, match=pattern):
        merge_campaign([flown[0] / "seed1", tmp_path / "other"], tmp_path / "all", ENGINE)
    assert not (tmp_path / "all").exists()


def test_mergeable_neighbours_are_listed_once(flown, tmp_path, monkeypatch):
    """Latin hypercubes, other code and incomplete campaigns cannot be merged."""
    campaign, parts = tmp_path / "f/campaign.yaml", flown[1]
    shutil.copytree(flown[0], tmp_path, dirs_exist_ok=True)
    run(campaign, tmp_path / "other_code", replace(ENGINE, source="other"), seed=5)
    run(campaign, tmp_path / "half", interrupted_after(5), seed=6)
    merge_campaign([tmp_path / "seed1", tmp_path / "seed2"], tmp_path / "all", ENGINE)
    sentence, command = suggest_merge(tmp_path / "seed3", parts[2])
    assert (
        "here: 'all' (400 flights: 1 " in sentence
        and f"merge {tmp_path}/seed3 {tmp_path}/all -o" in command
    )
    monkeypatch.chdir(tmp_path / "seed1")
    assert (
        f"{tmp_path}/seed2 {tmp_path}/seed3 -o {tmp_path}/seed1_merged"
        in suggest_merge(Path(), parts[0])[1]
    )
    _, (cube, _) = fly(tmp_path / "lhs", (1, 2), sampling="lhs")
    assert suggest_merge(tmp_path / "lhs/seed1", cube) == ("", "")


@pytest.mark.usefixtures("fake_engine", "no_figures")
def test_a_run_judges_its_folder_and_lists_neighbours(abhv_mc, tmp_path):
    """Exit code, JUnit file, last line and report refer to the same folder."""
    campaign = write_campaign(
        tmp_path / "f", requirements=ASKED.replace("0.93", "0.99"), runs="400"
    )
    assert abhv_mc(f"run {campaign} -o s1 --seed 1 --no-report")[0] == 1
    code, out, _ = abhv_mc(f"run {campaign} -o s2 --seed 2 --runs 60 --junit s2.xml")
    own = json.loads(Path("s2/manifest.json").read_text())["requirements"][0]
    assert (code, own["verdict"], own["flights"]) == (0, "NOT SHOWN", 60)
    assert own["words"] in Path("s2.xml").read_text() and "of 60 flights" in own["words"]
    before, verdicts = out.rsplit("verdicts  ", 1)
    assert "'s1' (400 flights: 1 FAIL)" in before.splitlines()[-1]
    assert "merge s2 s1 -o s2_merged" in before.splitlines()[-1]
    assert verdicts == "one: 1 NOT SHOWN; exit code 0\n"
    assert "'s1' (400 flights: 1 FAIL)" in html.unescape(
        Path("s2/report.html").read_text()
    ) and is_up_to_date(Path("s2"))
    assert abhv_mc("merge s2 s1 -o s2_merged --no-report")[0] == 1
    abhv_mc(f"run {campaign} -o s3 --seed 3 --runs 60 --no-report")
    assert not is_up_to_date(Path("s2"))
