"""Changed requirements: stored flights are judged again and not run again."""

import json
import shutil
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from fake_flight import ENGINE, interrupted_after, run, write_campaign

import abhv_mc
from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.requirement_set import judge_by
from abhv_mc.execution.flight_counts import RequirementCount
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.inputs import collect_inputs, describe_changes
from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.next_step import find_next_step
from abhv_mc.report.numbers.summary import summarize
from abhv_mc.report.pages.matrix import judged_cases, verdict_cases
from abhv_mc.statistics.verdicts import SET_LATER, UNSEARCHED
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS

LOOSE = "[{metric: altitude_error_max_m, below: 50, probability: 0.9}]"
TIGHT = "[{metric: altitude_error_max_m, below: 1.8, probability: 0.9}]"
OTHER = "[{metric: altitude_error_max_m, below: 1.8, probability: 0.8}, " + (
    "{metric: speed_error_max_mps, below: 9, probability: 0.9}]"
)
KEEP = "{histories: {flights: [7], rate: 10 Hz}, envelopes: {rate: 5 Hz}}"


def no_flight(*_):
    raise AssertionError("a flight was run")


IDLE = replace(ENGINE, fly=no_flight)


@pytest.mark.parametrize("early_is_failure", [True, False])
def test_early_terminations_count_if_the_requirement_says_so(early_is_failure):
    requirement = SimpleNamespace(limits=Bounds(high=5.0), early_is_failure=early_is_failure)
    counts = np.zeros((3, 2), np.int64)
    count = RequirementCount(requirement, True, np.zeros(4, bool), *counts)
    values, early = np.array([1.0, 9.0, np.nan, 1.0]), np.array([False, False, False, True])
    count.add(values, early, np.arange(4))
    assert count.missed.tolist() == [False, True, True, early_is_failure]
    assert counts.tolist() == [[2, 2], [0, int(early_is_failure)], [1, 1]]  # early, then measured


@pytest.fixture
def flown(tmp_path):
    campaign = write_campaign(tmp_path / "f", requirements=LOOSE, keep=KEEP)
    return run(campaign, tmp_path / "out").manifest, tmp_path / "out"


def statuses(manifest):
    entries = (*manifest.requirements, *manifest.requirements_shown)
    return [(entry.verdict, entry.failures, entry.words) for entry in entries]


@pytest.mark.parametrize("engine", [IDLE, replace(IDLE, source="another version")])
def test_a_run_with_other_limits_judges_the_stored_flights(flown, tmp_path, engine, capsys):
    before, out = flown
    tight = write_campaign(tmp_path / "g", requirements=TIGHT, keep=KEEP, author="A. Lead")
    after = run(tight, out, engine).manifest
    assert "altitude_error_max_m: below 50 -> 1.8" in capsys.readouterr().err
    assert after.digest == before.digest and after.complete
    reference = run(tight, tmp_path / "whole").manifest
    assert statuses(after) == statuses(reference) != statuses(before)
    assert [(item.file, item.flights) for item in after.requirement_sets] == [
        ("requirements/001.yaml", 0),
        ("requirements/002.yaml", 300),
    ]
    results = abhv_mc.open_results(out)
    change = "300 flights known: altitude_error_max_m: below 50 -> 1.8"
    assert change in " ".join(repr(results.summary).split())
    assert run(tight, out, engine).manifest == after  # unchanged


BASE = {"metric": "altitude_error_max_m", "below": 50, "probability": 0.9}
ALONE = {
    "metric": "speed_error_max_mps",
    "below": 49,
    "above": -9,
    "probability": 0.8,
    "consumer_risk": 0.2,
    "producer_risk": 0.05,
    "controllers": ["two"],
    "ended_early": "as_measured",
    "id": "GC-2",
}
SET_KEYS = {"family": {"risk": 0.05}, "under_test": ["two"]}


@pytest.fixture(scope="module")
def run_once(tmp_path_factory):
    """Return a function that runs 60 flights with requirements, once for each text."""

    def fly(requirements):
        root = tmp_path_factory.mktemp("base")
        path = write_campaign(root / "f", requirements=requirements, keep=KEEP, runs="60")
        return run(path, root / "out").folder

    return cache(fly)


@pytest.mark.parametrize("key", [*ALONE, *SET_KEYS])
@pytest.mark.parametrize("named", [{}, {"id": "GC-1"}])
def test_each_changed_key_is_named_on_the_first_screen(run_once, tmp_path, key, named):
    """Regression: a changed metric, and changed controllers, left no trace."""
    entry = {**BASE, **named}
    changed = {**entry, key: ALONE[key]} if key in ALONE else entry
    out = shutil.copytree(run_once(json.dumps([entry])), tmp_path / "out")
    content = {"requirements": [changed], **{k: v for k, v in SET_KEYS.items() if k == key}}
    judged = Models(read_flown(out, content))
    entries = {name: json.dumps(value) for name, value in content.items()}
    run(write_campaign(tmp_path / "g", **entries, keep=KEEP, runs="60"), out, IDLE)
    for models in (judged, Models(read_flown(out))):
        (change,) = models.results.requirement_changes
        assert change.key == key and change.old != change.new
        lines = [record.line for record in summarize(models).records]
        assert f"Changed after results: 60 flights known: {change}" in lines
        assert set(change.requirement.split()) <= {*map(str, entry.values()), "all", "requirements"}
        is_later = key not in ("below", "id", "family")
        verdict = models[VERDICTS].requirements[0].controllers["two"]
        assert verdict.set_later == is_later and ("(set later)" in verdict.label) == is_later
        assert "none: all" not in find_next_step(models).why or not is_later


def test_a_changed_window_of_a_metric_is_rejected_with_its_key(tmp_path):
    """Regression: a report with other windows was made without a word about them."""
    requirements = "[{metric: swing_deg, below: 9, probability: 0.9}]"
    first, other = (
        write_campaign(
            tmp_path / start,
            requirements=requirements,
            metrics=f"{{swing_deg: {{of: bank_deg, statistic: max, from: {start} s}}}}",
        )
        for start in "12"
    )
    campaigns = [read_campaign(path) for path in (first, other)]
    (change,) = describe_changes(*map(collect_inputs, campaigns), extensible=True)
    assert change == 'metrics.swing_deg.from: "1 s" -> "2 s"'  # by `run`
    assert judge_by(campaigns[0], first).requirements == campaigns[0].requirements
    with pytest.raises(InputError, match=r"'swing_deg'.*from 1 s -> 2 s"):
        judge_by(campaigns[0], other)


def test_judging_by_the_original_requirements_gives_the_same_numbers(flown, tmp_path):
    _, out = flown
    files = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    own = abhv_mc.open_results(out)
    judged = own.judge(out / "campaign.yaml")
    assert judged.numbers == own.numbers
    other = own.judge(
        {"requirements": [{"metric": "altitude_error_max_m", "below": 1.8, "probability": 0.9}]}
    )
    tight = run(write_campaign(tmp_path / "g", requirements=TIGHT, keep=KEEP), tmp_path / "whole")
    assert judged_cases(Models(other._results)[VERDICTS]) == verdict_cases(
        tight.manifest.requirements
    )
    assert files == {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    with pytest.raises(InputError, match="'altitud'"):
        own.judge([{"metric": "altitud", "below": 1.8, "probability": 0.9}])


def test_requirements_set_after_the_results_are_marked(flown, tmp_path):
    _, out = flown
    manifest = run(
        write_campaign(tmp_path / "g", requirements=OTHER, keep=KEEP), out, IDLE
    ).manifest
    sentences = [item.words for item in manifest.requirements]
    assert all(SET_LATER in item for item in sentences)
    judged = Models(read_flown(out))[VERDICTS]
    assert judged_cases(judged) == verdict_cases(manifest.requirements)
    manifest = run(
        write_campaign(tmp_path / "h", requirements=TIGHT, keep=KEEP), out, IDLE
    ).manifest
    assert SET_LATER not in manifest.requirements[0].words
    assert len(manifest.requirement_sets) == 3


def test_requirements_changed_before_any_flight_are_not_marked(tmp_path):
    run(write_campaign(tmp_path / "f", requirements=LOOSE), tmp_path / "out", interrupted_after(2))
    run(write_campaign(tmp_path / "g", requirements=TIGHT), tmp_path / "out")
    flown = read_flown(tmp_path / "out")
    assert len(flown.manifest.requirement_sets) == 2 and not flown.requirement_changes


def test_the_flights_known_at_the_first_of_several_changes_are_stated(flown, tmp_path):
    _, out = flown
    for name, entry, runs in (("g", TIGHT, "300"), ("h", TIGHT, "320"), ("i", OTHER, "320")):
        run(write_campaign(tmp_path / name, requirements=entry, keep=KEEP, runs=runs), out)
    results = read_flown(out)
    assert [item.flights for item in results.manifest.requirement_sets] == [0, 300, 320]
    assert results.changed_after == 300 and results.requirement_changes


def test_changed_rows_are_another_campaign(flown, tmp_path):
    _, out = flown
    for entries in (
        dict(seed="6"),
        dict(dispersions="{aero.lift: {distribution: normal, sigma: 4 %}}"),
    ):
        with pytest.raises(InputError, match=rf"(?s)/out: .*\b{next(iter(entries))}\b"):
            run(write_campaign(tmp_path / "g", **entries), out, IDLE)


def test_a_folder_of_a_former_version_resumes(flown, tmp_path):
    """Hashes of a former version include the requirements, and its manifest lists no sets."""
    _, out = flown
    path = out / "manifest.json"
    write_manifest(path, replace(read_manifest(path), campaign_hash="old", question="old"))
    again = run(write_campaign(tmp_path / "g", requirements=TIGHT, keep=KEEP), out, IDLE)
    assert again.complete and len(again.manifest.requirement_sets) == 2


def test_added_controllers_and_flights_keep_the_requirements(tmp_path):
    named = "[{metric: altitude_error_max_m, below: 50, probability: 0.9, controllers: [one, two]}]"
    campaign = write_campaign(tmp_path / "f", requirements=named, keep=KEEP)
    run(campaign, tmp_path / "out", controllers=("one",), runs=64)
    manifest = run(campaign, tmp_path / "out", runs=128).manifest
    assert not manifest.requirement_sets
    assert [item.controller for item in manifest.requirements] == ["one", "two"]


def test_shards_with_different_requirements_merge_with_one_set_named(tmp_path):
    loose = write_campaign(tmp_path / "f", requirements=LOOSE, keep=KEEP)
    tight = write_campaign(tmp_path / "g", requirements=TIGHT, keep=KEEP)
    parts = [tmp_path / f"part{i}" for i in (1, 2)]
    for number, (campaign, shard) in enumerate(zip((loose, tight), parts, strict=True), 1):
        run(campaign, shard, shard=(number, 2))
    with pytest.raises(InputError, match=r"below 50 -> 1\.8.*--requirements"):
        merge_campaign(parts, tmp_path / "merged", ENGINE)
    merged = merge_campaign(parts, tmp_path / "merged", ENGINE, requirements=tight).manifest
    reference = run(tight, tmp_path / "whole").manifest
    assert (merged.digest, statuses(merged)) == (reference.digest, statuses(reference))


def test_requirements_without_a_search_of_the_unknowns_are_not_shown(tmp_path):
    points = (
        "{tried: 7, at: {aero.drag: [0.8, 1.15]}, shared: 1, most_failures:"
        " [{controller: one, requirement: 0, point: 1, failures: 9, tried: 7}]}"
    )
    entries = dict(
        controllers="{one: one.yaml}", keep=KEEP, runs="60", points=points,
        unknowns="{aero.drag: {low: -20 %, high: 15 %}}",
    )  # fmt: skip
    campaign = write_campaign(tmp_path / "f", requirements=LOOSE.replace("0.9", "0.5"), **entries)
    first = run(campaign, tmp_path / "out").manifest
    assert first.requirements[0].verdict == "PASS"
    looser = "[{metric: speed_error_max_mps, below: 99, probability: 0.5}, " + LOOSE[1:].replace(
        "0.9", "0.5"
    )
    del entries["points"]
    changed = write_campaign(tmp_path / "g", requirements=looser, **entries)
    speed, altitude = run(changed, tmp_path / "out", IDLE).manifest.requirements
    assert speed.verdict == "NOT SHOWN" and UNSEARCHED in speed.words
    assert (altitude.verdict, altitude.failures) == ("PASS", first.requirements[0].failures)
    assert read_campaign(tmp_path / "out/campaign.yaml").unknowns.most_failures[0].requirement == 1


def test_the_planned_number_of_flights_is_that_of_the_last_file(tmp_path):
    first = write_campaign(tmp_path / "f", runs="100")
    assert run(first, tmp_path / "out", runs=40).manifest.file_runs == 100
    second = write_campaign(tmp_path / "g", runs="40")
    again = run(second, tmp_path / "out").manifest
    assert again.file_runs is None and again.runs_done == 40
