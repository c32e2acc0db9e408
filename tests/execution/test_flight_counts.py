"""Counts of missed requirements and outcomes."""

from dataclasses import replace

import numpy as np
import pytest
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.flight_counts import Completion, count_flights, judge_counts
from abhv_mc.folder.flights import Digest, FlightRows
from abhv_mc.folder.manifest import Manifest

EMPTY = Manifest(name="x", state="running", seed=1, campaign_hash="", source_hash="")
OUTCOMES = ("ok", "ok", "sideslip_limit", "sideslip_limit", "failed_to_run", "ok")
VALUES = [50.0, 49.0, 51.0, 9.0, np.nan, np.nan]  # the limit of 50 itself is missed


@pytest.fixture
def completion(tmp_path):
    """Six flights at three points of an unknown; of the second controller only five."""
    campaign = write_campaign(
        tmp_path,
        runs="2",
        keep="{histories: {flights: []}}",
        unknowns="{aero.drag: {low: 0.8, high: 1.2}}",
        points="{at: {aero.drag: [0.8, 1.0, 1.2]}}",
        requirements="[{metric: altitude_error_max_m, below: 50, probability: 0.9},"
        " {metric: altitude_error_max_m, below: 50, probability: 0.9, ended_early: as_measured}]",
    )
    completion = Completion(read_campaign(campaign), (0, 6), ("one", "two"))
    for name, number in (("one", 6), ("two", 5)):
        values = np.array(VALUES[:number])[:, None]
        outcomes = OUTCOMES[:number] if name == "one" else (*OUTCOMES[:4], "ok")
        values[4:5] = 1.0 if name == "two" else np.nan
        columns, samples = ("altitude_error_max_m",), np.empty((number, 0))
        rows = FlightRows(name, 0, (), samples, outcomes, values, columns)
        completion.add(rows, Digest(number))
    return completion


def test_flights_are_missed_by_value_early_end_or_lack_of_a_value(completion):
    early, measured = completion.all_counts["one"].requirements
    assert np.flatnonzero(early.missed).tolist() == [0, 2, 3, 5]
    assert np.flatnonzero(measured.missed).tolist() == [0, 2, 5]
    assert early.flights.tolist() == [2, 1, 2]  # flights 0 and 3, 1, and 2 and 5
    assert early.measured.tolist() == measured.measured.tolist() == [1, 0, 2]
    assert (early.ended_early.tolist(), measured.ended_early.tolist()) == ([1, 0, 0], [0, 0, 0])
    counts = completion.all_counts["one"]
    assert (counts.failed.tolist(), counts.not_computed) == ([2, 3], [4])


def test_the_verdict_is_that_of_the_point_with_the_most_failures(completion):
    judged = judge_counts(completion.all_counts, completion.campaign)
    assert [point for *_, point in judged] == [0, 2, 0, 2]
    counted = [(verdict.flights, verdict.failures) for _, _, verdict, _ in judged]
    assert counted == [(2, 2), (2, 2), (2, 2), (1, 1)]
    uncomputed = completion.all_counts["one"].uncomputed
    uncomputed[[1, 4]] = True
    judged = judge_counts(completion.all_counts, completion.campaign, 5)[1]
    assert (judged[3], judged[2].flights, judged[2].uncomputed) == (1, 2, 2)
    uncomputed[1] = False
    first = [
        verdict.flights
        for *_, verdict, _ in judge_counts(completion.all_counts, completion.campaign, 3)
    ]
    assert first == [1] * 4


def test_the_manifest_counts_the_flights_of_all_controllers(completion):
    manifest, gapless = count_flights(EMPTY, completion.all_counts, completion.done)
    assert (manifest.runs_done, manifest.runs_failed, gapless) == (4, 1, 5)
    assert [own.flights_done for own in manifest.controllers.values()] == [6, 5]
    assert manifest.controllers["one"].outcomes == {
        "failed_to_run": 1,
        "ok": 3,
        "sideslip_limit": 2,
    }
    assert [own.failed_to_run for own in manifest.controllers.values()] == [(4,), None]
    assert manifest.digest == str(Digest(11)) and manifest.digests["two"] == str(Digest(5))
    assert not completion.is_complete()
    done = {name: np.arange(6) != 2 for name in completion.done}
    assert count_flights(replace(EMPTY), completion.all_counts, done)[1] == 2
    missing = completion.find_missing({})
    assert [np.flatnonzero(rows).tolist() for rows, _ in missing.values()] == [[], [5]]
