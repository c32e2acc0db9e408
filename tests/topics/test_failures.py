"""Rules in words for planted failures."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.analysis.failure_map import ControllerFailures, Dispersed, FailureGroup
from abhv_mc.topics.failures import FAILURES, map_table
from abhv_mc.topics.simulator import SIMULATOR, FailureReason, SimulatorFacts, compute_simulator
from abhv_mc.topics.topic import Models, Records

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


def names_for(is_repeatable):
    capabilities = SimpleNamespace(is_repeatable=is_repeatable)
    simulator = SimpleNamespace(capabilities=capabilities)
    return SimpleNamespace(
        campaign=SimpleNamespace(simulator=simulator), kind="System", label=str.upper
    )


@pytest.mark.parametrize("is_repeatable", [True, False])
def test_reasons_and_events_of_a_simulator_have_rows(is_repeatable):
    """At most 20 reasons of each system are listed."""
    reasons = tuple(FailureReason(f"r{k}", 1200 - k, k + 3) for k in range(22))
    facts = SimulatorFacts(
        repeatable="no",
        events={"a": {"restarts": 1500, "other": 2}, "b": {"surplus": 1}},
        notes=("first", "second"),
        files=("x.py", "y.csv"),
        reasons={"a": reasons, "b": reasons[:1]},
    )
    names = names_for(is_repeatable)
    records, *_ = SIMULATOR.section(facts, names).items
    assert isinstance(records, Records)
    lines = {record.label: record.line for record in records.records}
    assert lines["Note"] == "Note: first; second" and "x.py, y.csv" in [*lines.values()][-1]
    assert len(lines["Repeatable"]) > 15
    events, failed = SIMULATOR.section(facts, names).tables()
    assert [[row[0], *row[2:]] for row in events.plain_rows()] == [
        ["A", "1500"], ["A", "2"], ["B", "1"]]  # fmt: skip
    assert events.plain_rows()[1][1] == "other"
    expected = [["A", f"r{k}", f"{1200 - k}", f"{k + 3}"] for k in range(20)]
    assert failed.plain_rows() == [*expected, ["B", "r0", "1200", "3"]]
    quiet = replace(facts, reasons={}, events={})
    section = SIMULATOR.section(quiet, names)
    assert section is None if is_repeatable else section.tables() == []
    nothing = SimulatorFacts(None, {}, (), (), {})
    assert SIMULATOR.section(nothing, names) is None


@pytest.mark.parametrize(
    ("can_rerun", "is_repeatable", "noted"),
    [(True, False, True), (True, True, False), (False, False, False), (False, True, False)],
)
def test_facts_of_a_simulator_are_those_of_the_manifest(flown, can_rerun, is_repeatable, noted):
    inputs = {"inputs/simulator/a/b.py": "0", "inputs/vehicle.yaml": "1", "inputs/simulator/c": "2"}
    results = flown(80)
    manifest = replace(results.manifest, warnings=("w",), inputs=inputs, simulator_events=None)
    capabilities = SimpleNamespace(can_rerun=can_rerun, is_repeatable=is_repeatable)
    campaign = SimpleNamespace(simulator=SimpleNamespace(capabilities=capabilities))
    stub = SimpleNamespace(manifest=manifest, campaign=campaign, flights=results.flights)
    facts = compute_simulator(stub)
    assert (facts.files, facts.events, facts.reasons) == (("a/b.py", "c"), {}, {})
    assert facts.notes == (("w",) if noted else ())
    events = {"tlc": {"restarts": 3}}
    stub.manifest = replace(manifest, simulator_events=events)
    assert compute_simulator(stub).events == events
