"""Counts of missed requirements and outcomes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution import flight_counts
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


@pytest.mark.parametrize(
    ("gapless", "stop", "points", "needed", "goal"),
    [
        ((0, 0), 1000, 1, {}, 64),
        ((0, 0), 50, 1, {}, 50),
        ((63, 900), 1000, 1, {}, 64),
        ((64, 900), 1000, 1, {}, 64),
        ((75, 900), 1000, 1, {}, 75),  # all flights that are there are judged
        ((100, 900), 1000, 1, {64: [80, 90], 80: [500]}, 160),  # at most twice as many
        ((100, 900), 1000, 1, {64: [10], 70: [85], 85: [500]}, 170),  # at least a tenth more
        ((100, 900), 90, 1, {64: [80], 80: [500]}, 90),
        ((100, 900), 1000, 1, {64: [80], 80: []}, 100),
        ((200, 900), 1000, 3, {192: [10]}, 210),  # a tenth more is a multiple of the points
        ((200, 900), 1000, 3, {192: [75, 80]}, 225),
    ],
)
def test_a_campaign_stops_at_numbers_of_flights_that_depend_on_verdicts(
    monkeypatch, gapless, stop, points, needed, goal
):
    """``needed`` are the flights for PASS, at each point, of the verdicts not shown."""

    def judge(counts, campaign, flights):
        verdicts = [("NOT SHOWN", number, True) for number in needed.get(flights, [])]
        others = [("PASS", 1, True), ("FAIL", 1, True), ("NOT SHOWN", 1, False)]
        return [
            (
                None,
                SimpleNamespace(binds=binds),
                SimpleNamespace(status=status, failures=n, probability=0.5, consumer_risk=0.1),
                0,
            )
            for status, n, binds in (*others, *verdicts)
        ]

    monkeypatch.setattr(flight_counts, "judge_counts", judge)
    monkeypatch.setattr(flight_counts, "flights_to_pass", lambda failures, *target: failures)
    campaign = SimpleNamespace(
        model=SimpleNamespace(stop="when proven"), unknowns=SimpleNamespace(points=[0] * points)
    )
    done = {k: np.arange(stop) < number for k, number in enumerate(gapless)}
    completion = SimpleNamespace(campaign=campaign, stop=stop, done=done, all_counts=None)
    assert Completion.goal(completion) == goal
    campaign.model.stop = None
    assert Completion.goal(completion) == stop


def test_missing_envelopes_are_those_of_computed_and_requested_flights(completion):
    """The first controller has all flights, of which 4 failed to run; the second lacks flight 5."""
    covered = np.array([True, False, True, True, False, True])
    collectors = {name: SimpleNamespace(covered=covered.copy()) for name in ("one", "two")}
    collectors["two"].covered[5] = False
    for requested in (("one", "two"), ("one",)):
        completion.requested = requested
        missing = completion.find_missing(collectors)
        found = {k: [np.flatnonzero(mask).tolist() for mask in own] for k, own in missing.items()}
        rest = [5] if "two" in requested else []
        assert found == {"one": [[], [1]], "two": [rest, [1, 4, *rest]]}
    assert completion.find_missing({}) == {}
    completion.requested = ("one", "two")
    completion.stop = 5
    assert completion.find_missing({}) == {} and completion.is_complete()
