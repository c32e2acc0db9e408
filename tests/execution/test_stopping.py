"""Campaigns that stop when proven: flights and verdicts do not depend on how they are run."""

import shutil
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import DENSITY, ENGINE, fly, interrupted_after, run, write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.flight_counts import Completion
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc.topics.verdicts.model import compute_verdicts

# About 4 % of the fake flights end early: proven at 90 %, disproven at 99 %.
PROVEN = "[{metric: altitude_error_max_m, below: 50, probability: 0.9}]"
BOTH = "[{metric: altitude_error_max_m, below: 50, probability: 0.9}, \
{metric: speed_error_max_mps, below: 50, probability: 0.99, controllers: [two]}]"
FILES = (
    "samples.parquet",
    "envelopes.parquet",
    "histories/one-000000.parquet",
    "histories/two-000000.parquet",
)


def make(folder, **entries):
    return write_campaign(
        folder, **{"stop": "when proven", "runs": "2000", "requirements": BOTH, **entries}
    )


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return run(make(folder / "f"), folder / "out")


def test_verdicts_wait_for_the_flights_of_all_controllers(tmp_path):
    completion = Completion(read_campaign(make(tmp_path)), (0, 2000), ("one", "two"))
    for controller, flights in (("one", 500), ("two", 63)):
        completion.done[controller][:flights] = True
        assert completion.goal() == 64
    completion.done["two"][63] = True
    assert completion.goal() > 64


@pytest.mark.parametrize(
    ("probability", "failures", "goal"), [(0.8, 4, 64), (0.8, 5, 70), (0.9, 2, 81), (0.99, 0, 128)]
)
def test_verdicts_are_next_judged_where_they_can_be_pass(tmp_path, probability, failures, goal):
    """PASS needs 66, 81 and 264 flights; between a tenth and all of 64 flights are added."""
    requirements = PROVEN.replace("0.9", str(probability))
    campaign = read_campaign(make(tmp_path, requirements=requirements))
    completion = Completion(campaign, (0, 2000), ("one", "two"))
    for name, done in completion.done.items():
        done[:64] = True
        completion.all_counts[name].requirements[0].missed[:failures] = True
    assert completion.goal() == goal


def test_a_campaign_stops_when_all_verdicts_are_final(reference):
    manifest = reference.manifest
    stop = manifest.stopped_at
    assert manifest.state == "complete" and 64 <= stop < 2000
    assert manifest.runs_done == stop
    assert [entry.verdict for entry in manifest.requirements] == ["PASS", "FAIL"]
    assert {entry.flights for entry in manifest.requirements} == {stop}
    first, second = (
        entry.controllers for entry in compute_verdicts(read_flown(reference.folder)).requirements
    )
    assert (first["one"].status, second["two"].status) == ("PASS", "FAIL")
    assert first["one"].room > 0.0 > (second["two"].room or -1.0)
    flights = pq.read_table(reference.folder / "flights")
    assert sorted(flights["flight"].to_pylist()) == sorted([*range(stop), *range(stop)])
    assert max(pq.read_table(reference.folder / "envelopes.parquet")["count"].to_pylist()) == stop


def test_stored_flights_beyond_the_decision_belong_to_the_campaign(tmp_path):
    campaign = read_campaign(make(tmp_path / "f", requirements=PROVEN))
    completion = Completion(campaign, (0, 2000), ("one", "two"))
    for done in completion.done.values():
        done[:300] = True  # without failures, 64 flights decide
    assert completion.goal() == 300 and completion.is_complete()


@pytest.mark.parametrize("execution", ["{workers: 1, batch: auto}", "{workers: 3, batch: 16}"])
def test_the_result_does_not_depend_on_workers_and_blocks(reference, tmp_path, execution):
    other = run(make(tmp_path / "g", execution=execution), tmp_path / "b").manifest
    assert (
        other.digest == reference.manifest.digest
        and other.stopped_at == reference.manifest.stopped_at
    )
    for name in FILES:
        assert pq.read_table(reference.folder / name).equals(pq.read_table(tmp_path / "b" / name))


def test_failed_flights_after_the_stop_are_run_again(tmp_path):
    """Failed flights beyond the stop are run again by the same command."""

    def fail(plan, parameters, every=None):
        block = fly(plan, parameters, every)
        off = np.abs(parameters[:, DENSITY] - 1.0)
        block.outcome[(off > 0.0) & (off < 0.01)] = Outcome.FAILED_TO_RUN  # the trials have 1
        return block

    campaign = make(tmp_path / "f", requirements=PROVEN)
    reference = run(make(tmp_path / "g", requirements=PROVEN), tmp_path / "whole").manifest
    weak = run(campaign, tmp_path / "out", replace(ENGINE, fly=fail)).manifest
    done = weak.runs_done + weak.runs_failed
    assert weak.runs_failed and done == weak.stopped_at > reference.stopped_at
    again = run(campaign, tmp_path / "out").manifest
    assert again.runs_failed == 0
    assert [entry.verdict for entry in again.requirements] == ["PASS"]


@pytest.mark.parametrize("blocks", [1, 6])
def test_the_result_does_not_depend_on_interruptions(reference, tmp_path, blocks):
    campaign = make(tmp_path / "f", execution="{workers: 2, batch: 16}")
    assert not run(campaign, tmp_path / "b", interrupted_after(blocks + 2)).complete
    second = run(campaign, tmp_path / "b").manifest
    assert (
        second.digest == reference.manifest.digest
        and second.requirements == reference.manifest.requirements
    )


def test_a_proven_campaign_runs_no_more_flights(reference, tmp_path):
    campaign, stop = make(tmp_path / "f"), reference.manifest.stopped_at
    shutil.copytree(reference.folder, tmp_path / "out")

    def never(*_):
        raise AssertionError("flown again")

    assert run(campaign, tmp_path / "out", replace(ENGINE, fly=never)).complete
    again = run(tmp_path / "out/campaign.yaml", tmp_path / "again").manifest
    assert again.campaign_hash == reference.manifest.campaign_hash
    assert run(campaign, tmp_path / "out", runs=4000).manifest.stopped_at == stop


def test_an_unproven_campaign_runs_all_flights(tmp_path):
    close = "[{metric: altitude_error_max_m, below: 50, probability: 0.97}]"
    manifest = run(make(tmp_path / "f", runs="60", requirements=close), tmp_path / "out").manifest
    assert (manifest.stopped_at, manifest.requirements[0].verdict) == (60, "NOT SHOWN")


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        (dict(sampling="lhs"), "sampling: random"),
        (dict(requirements="[]"), "'stop'"),
        (dict(stop="when bored"), "when bored"),
    ],
)
def test_a_stop_without_sequential_verdicts_is_rejected(tmp_path, entries, message):
    path = make(tmp_path / "f", **entries)
    with pytest.raises(InputError) as caught:
        read_campaign(path)
    assert message in str(caught.value) and caught.value.line
