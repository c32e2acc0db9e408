"""Outcomes, findings and dispersions of flights."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.flights.statistic import Statistic
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.flights.model import (
    LargeDispersion,
    _largest,
    _moments,
    channel_of,
    limit_sides,
    rank_failed,
)
from abhv_mc.topics.topic import Models


def test_events_come_before_dispersions_sorted_by_their_distance():
    columns = {
        "wide": [0.0, 4.0, 2.0],
        "small": [0.1, 0.1, 0.4],
        "same": [5.0, 5.0, 5.0],
        "failure": [7.0, np.inf, np.inf],
    }
    moments = {name: _moments(np.array(column)) for name, column in columns.items()}
    flights = [{name: column[k] for name, column in columns.items()} for k in range(3)]
    sigma = 2.0 / np.sqrt(8.0 / 3.0)  # 0, 4 and 2 have a mean of 2
    first, second, third = _largest(flights[0], moments)
    assert first == LargeDispersion("failure", 7.0, None)
    assert (second.parameter, second.sigma) == ("wide", pytest.approx(-sigma))
    assert (third.parameter, third.sigma) == ("small", pytest.approx(-1 / np.sqrt(2.0)))
    assert [item.parameter for item in _largest(flights[2], moments)] == ["small", "wide", "same"]


def test_the_channel_of_a_metric_has_the_longest_equal_beginning():
    record = SimpleNamespace(of="bank_error_deg", name="x", statistic=Statistic.MAX_ABS)
    stems = {"bank_deg": "bank", "bank_error_2_deg": "bank_error"}
    assert channel_of(record, stems, stems) == "bank_error_2_deg"
    assert channel_of(record, ["bank_deg", "bank_error_deg"], stems) == "bank_error_deg"
    assert channel_of(record, ["mach"], {}) is None
    assert limit_sides(record, ["bank_error_deg"]) == (-1.0, 1.0)
    assert limit_sides(record, ["bank_deg"]) == ()


def test_outcomes_and_findings_are_counted(flown):
    """Of the flights, 3 terminate early, 4 saturate, 5 leave tables, and 2 oscillate."""
    results = flown(80)
    tlc = results.flights["tlc"]
    metrics, kinds = dict(tlc.metrics), {"saturates": 4, "leaves_tables": 5, "cycles": 2}
    for name, record in tlc.records.items():
        if record.finding and name in metrics:
            count = kinds[record.finding]
            high, low = (5.1, 5.0) if record.finding == "cycles" else (0.1, 0.0)
            metrics[name] = np.where(np.arange(80) < count, high, low)
    outcome = np.where(np.arange(80) < 3, 3, 0)
    changed = replace(tlc, metrics=metrics, outcome=outcome, absent=np.array([80, 81]))
    manifest = replace(
        results.manifest,
        controllers={
            **results.manifest.controllers,
            "gone": SimpleNamespace(outcomes={"failed_to_run": 9}),
        },
    )
    models = Models(
        replace(results, manifest=manifest, flights={**results.flights, "tlc": changed})
    )
    found = models[FLIGHTS]
    counts, findings = found.counts["tlc"], found.findings["tlc"]
    assert (counts.flown, counts.failed, counts.not_computed) == (80, 3, 2)
    assert counts.failure_share.value == 3 / 80 and found.left_out == {"gone": 9}
    assert counts.failure_share.low < 3 / 80 < counts.failure_share.high
    assert (findings.saturated, findings.outside_tables) == (4, 5)
    assert set(findings.cycling.values()) == {2}
    assert {*rank_failed(models.results, "tlc")} >= {0, 1, 2}


@pytest.mark.parametrize("can_rerun", [True, False])
def test_commands_that_fly_are_named_only_where_flights_can_be_run_again(
    flown, monkeypatch, can_rerun
):
    models = Models(flown(200))
    monkeypatch.setattr(type(models.names.campaign), "can_rerun", can_rerun)
    section = FLIGHTS.section(models[FLIGHTS], models.names)
    texts = " ".join(item.text for item in section.items if hasattr(item, "text"))
    assert ("abhv-mc explain" in texts) is can_rerun
