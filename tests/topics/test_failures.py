"""Rules in words for planted failures."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.analysis.failure_map import ControllerFailures, Dispersed, FailureGroup
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.statistics.failure_rules import Condition, Rule
from abhv_mc.topics.failures import FAILURES, FailureKind, FailureRule, Failures, map_table
from abhv_mc.topics.formatting import shown_value
from abhv_mc.topics.missed_requirements import failure_kinds
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


def rule(*conditions, **entries):
    counts = {"failures_inside": 3, "failures": 4, "others_inside": 1, "others": 20}
    return {"conditions": conditions, **counts, "p_value": 0.01, "q_value": 0.02, **entries}


def test_regions_have_their_thresholds_and_medians(flown, monkeypatch):
    """The medians are of the failures on one side of the difference."""
    drag, density = "aero.drag", "atmosphere.density"
    above, below = Condition(drag, True, 1.08), Condition(density, False, 0.93)
    difference = Condition(density, True, 0.5, minus=drag)
    rules = [
        rule(above),
        rule(below, above),
        rule(Condition(drag, False, 0.93), above, either=True),
        rule(difference),
        rule(difference, either=True),
        rule(replace(difference, above=False)),
    ]
    monkeypatch.setattr(
        "abhv_mc.topics.failures.find_rules", lambda *_: [Rule(**entries) for entries in rules]
    )
    results, minus = flown(80), "\N{MINUS SIGN}"
    parameters = results.campaign.parameters
    failed = results.samples[drag] > 1.0
    found = rules_of(results, failed)
    assert found[:3] == [
        "drag above +8.0\xa0%",
        f"density at most {minus}7.0\xa0% and drag above +8.0\xa0%",
        f"drag at most {minus}7.0\xa0% or above +8.0\xa0%",
    ]
    scaled = {x: (values - values.mean()) / values.std() for x, values in results.samples.items()}
    high = scaled[density] - scaled[drag] > 0.5
    for text, level, side in (
        (found[3], "high", high),
        (found[4], "high or low", high),
        (found[5], "low", ~high),
    ):
        shown = [
            f"{name.partition('.')[2]} {shown_value(name, np.median(x[side & failed]), parameters)}"
            for name, x in ((density, results.samples[density]), (drag, results.samples[drag]))
        ]
        assert f": {level} (such as {', '.join(shown)})" in text
        assert text.startswith("density minus drag")


def test_failure_modes_have_their_counts_and_at_most_two_rules(flown, monkeypatch):
    """The controller with the most failures is first."""
    names = Models(flown(80)).names

    def made(**entries):
        return FailureRule(where=entries.pop("where"), **rule(Condition("a", True, 1.0), **entries))

    rules = tuple(
        made(where=f"w{k}", failures_inside=30 + k, failures=60, others_inside=k, others=25)
        for k in range(3)
    )
    kinds = {
        "tlc": (FailureKind("ended early", 1200, 4, ()),),
        "lqr_retuned": (),
        "lqr": (FailureKind("ended early", 85, 60, rules), FailureKind("missed: x", 85, 5, ())),
    }
    section = FAILURES.section(Failures(kinds, fewest_failures=5), names)
    (table,) = section.tables()
    thin = "\u202f"
    assert table.plain_rows() == [
        ["LQR", "ended early", "60 of 85", "w0", f"50{thin}%", f"0{thin}%"],
        ["LQR", "ended early", "60 of 85", "w1", f"52{thin}%", f"4{thin}%"],
        ["LQR", "missed: x", "5 of 85", "no significant rule", "", ""],
        ["TLC", "ended early", "4 of 1200", "no significant rule (fewer than 5 flights)", "", ""],
    ]
    commands = [item.text for item in section.items if hasattr(item, "text")]
    assert sum("explain" in text for text in commands) == 1
    monkeypatch.setattr(Experiment, "can_rerun", False)
    assert len(FAILURES.section(Failures(kinds), names).items) == 1
    assert FAILURES.section(Failures({"tlc": ()}), names).tables() == []
    found = ControllerFailures(3, (), nominal=(), unexplained=(1, 2, 3), tried=50)
    section = FAILURES.section(Failures(kinds, {"lqr": found}), names)
    assert section.tables()[0].plain_rows()[0][4] == "3 of 3"
    assert any("--controller lqr " in getattr(item, "text", "") for item in section.items)


def test_modes_of_failures_are_those_that_occurred(flown):
    results = flown(80)
    number = np.arange(80)
    metrics = {item.metric: np.zeros(80) for item in results.campaign.requirements}
    metrics["altitude_error_max_m"] = np.where(number < 3, 51.0, 0.0)
    tlc = replace(results.flights["tlc"], metrics=metrics, outcome=np.where(number == 7, 3, 0))
    kinds = dict(failure_kinds(replace(results, flights={"tlc": tlc}), "tlc"))
    assert [np.flatnonzero(mask).tolist() for mask in kinds.values()] == [
        [7], [0, 1, 2, 7], [7], [7]]  # fmt: skip
    assert [*kinds][:2] == ["ended early", "missed: Altitude error, max < 50\xa0m"]
    tlc = replace(tlc, outcome=np.zeros(80, int))
    ((name, mask),) = failure_kinds(replace(results, flights={"tlc": tlc}), "tlc")
    assert name.startswith("missed: Altitude") and mask.sum() == 3
