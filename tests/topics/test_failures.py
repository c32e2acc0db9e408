"""Rules in words for planted failures."""

import re
from dataclasses import replace

import numpy as np

from abhv_mc.analysis.failure_map import ControllerFailures, Dispersed, FailureGroup
from abhv_mc.topics.failures import FAILURES, map_table
from abhv_mc.topics.simulator import compute_simulator
from abhv_mc.topics.topic import Models

METRIC = "speed_error_max_mps"  # below 5


def rules_of(results, failed):
    """Return the rules, in words, of the flights of LQR that miss the limit of the speed error."""
    flights = results.flights["lqr"]
    metrics = {**flights.metrics, METRIC: np.where(failed[flights.flight], 9.0, 1.0)}
    results = replace(results, flights={"lqr": replace(flights, metrics=metrics)})
    kinds = Models(results)[FAILURES].controllers["lqr"]
    (kind,) = (entry for entry in kinds if "Speed" in entry.kind)
    return [rule.where for rule in kind.rules]


def test_a_difference_of_inputs_is_said_as_directions_with_an_example(flown):
    results = flown(80)
    density = (results.samples["atmosphere.density"] - 1.0) / 0.10
    drag = (results.samples["aero.drag"] - 1.0) / 0.15
    rule = rules_of(results, density - drag > 1.2)[0]
    assert re.search(r"\bdensity \w+ drag\b.*: high\b", rule)
    assert re.search(r"\([^)]*\bdensity \+[^)]*, drag \N{MINUS SIGN}", rule)
    both = rules_of(results, np.abs(density - drag) > 1.2)[0]
    assert "high or low" in both


def test_a_threshold_of_one_input_is_said_with_its_value(flown):
    results = flown(80)
    drag = results.samples["aero.drag"]
    assert re.match(r"drag above \+\d", rules_of(results, drag > 1.08)[0])


def test_a_map_has_the_share_and_the_range_of_each_group(flown):
    names = Models(flown(80)).names
    lift = Dispersed("aero.lift", False, 0.91, 0.93, 0.94)
    drag = Dispersed("aero.drag", True, 1.1, 1.1, 1.1)
    group = FailureGroup("ended early", (lift, drag), (7, 3, 5))
    found = ControllerFailures(9, (group,), nominal=(1,), unexplained=(2, 4), tried=50)
    rows = map_table({"tlc": found, "lqr": replace(found, failed=0)}, names).plain_rows()
    minus = "\N{MINUS SIGN}"
    values = f"{minus}7.0 % ({minus}9.0 % to {minus}6.0 %); +10.0 %".replace(" %", "\xa0%")
    head, share = ["TLC", "ended early", "lift low, drag high"], "3 of 6 (50\u202f%)"
    assert rows[0] == [*head, values, share, "7"]
    assert [row[4] for row in rows[1:]] == ["2 of 6", "1", "6 of 9"]


def test_reasons_are_counted_with_their_first_flights(flown):
    results = flown(80)
    reasons = {5: "b", 7: "a", 2: "a", 9: "a", 1: ""}
    flights = {"tlc": replace(results.flights["tlc"], reasons=reasons)}
    (own,) = compute_simulator(replace(results, flights=flights)).reasons.values()
    assert {(reason.flights, reason.first) for reason in own} == {(3, 2), (1, 5), (1, 1)}
    assert (own[0].reason, own[0].flights) == ("a", 3)
