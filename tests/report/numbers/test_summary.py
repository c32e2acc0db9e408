"""Summary of a campaign with its next step, and chances of PASS of a planned campaign."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fake_flight import write_campaign as write_fake
from report.synthetic import build_page, write_campaign
from scipy.stats import binom

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers import summary
from abhv_mc.report.numbers.next_step import NextStep
from abhv_mc.report.numbers.pass_chances import plan_campaign
from abhv_mc.report.numbers.summary import confidence_records, read_summary, summarize
from abhv_mc.statistics.estimates import Interval
from abhv_mc.statistics.evidence import flights_to_pass, most_failures
from abhv_mc.statistics.verdicts import SET_LATER, judge
from abhv_mc.topics.comparison.model import make_standings
from abhv_mc.topics.formatting import MINUS, json_data, percent
from abhv_mc.topics.topic import Models

REQUIRED = (
    "{{metric: speed_error_max_mps, below: {limit}, probability: {probability}, "
    "consumer_risk: 0.1}}"
)


def lines_of(models):
    """Return the entries of the summary by label, as lines."""
    records = summarize(models).records
    return {record.label: [entry.line for entry in record.entries] for record in records}


def judged(folder, requirements, **keys):
    keys = {"controllers": ["tlc", "lqr"], **keys}
    models = Models(read_flown(write_campaign(folder, requirements=requirements, **keys)))
    return lines_of(models), models


@pytest.mark.parametrize(
    ("limit", "probability", "label", "command"),
    [
        (1e6, 0.5, "Meets all 1 requirements", "none"),
        (1e6, 0.95, "Meets all 1 requirements", "joint PASS"),
        (1e6, 0.98, "Not shown", "--runs"),
        (1e-9, 0.9, "Misses", "explain DIR --all"),
    ],
)
def test_what_is_met_and_what_would_help(tmp_path, limit, probability, label, command):
    lines, _ = judged(tmp_path / "c", [REQUIRED.format(limit=limit, probability=probability)])
    assert lines[label][0].startswith("LQR, TLC") and command in lines["Next"][0]
    assert ("Risk" in lines) == label.startswith("Meets")  # only of a PASS
    assert ("Flights needed" in lines) == (label == "Not shown")


def test_the_stored_summary_is_the_same_and_fits_a_terminal(tmp_path):
    folder = tmp_path / "c"
    _, models = judged(folder, [REQUIRED.format(limit=1e6, probability=0.99)])
    build_page(folder)
    manifest = read_flown(folder).manifest
    assert read_summary(folder, manifest).records == summarize(models).records
    assert max(map(len, repr(summarize(models)).splitlines())) <= 80
    assert (
        read_summary(folder, replace(manifest, digest="another"))
        is read_summary(tmp_path, manifest)
        is None
    )


def test_early_terminations_name_who_has_fewer_and_alone_nothing_is_compared(tmp_path):
    requirements = [REQUIRED.format(limit=1e6, probability=0.5)]
    lines, _ = judged(tmp_path / "c", requirements, failing=20)
    assert lines["Early terminations"] == ["LQR: 20 of 60, more than TLC"]
    assert not {"Better in", "Not beaten"} & {
        *judged(tmp_path / "one", requirements, controllers=["tlc"])[0]
    }
    assert "No comparison" in judged(tmp_path / "lhs", requirements, sampling="lhs", runs=16)[0]


def test_missed_requirements_name_the_most_exceeded_for_few_controllers(tmp_path):
    """All flights miss two requirements, of which one allows half and the other 10 %."""
    metrics = {"speed_error_max_mps": 1e-9, "sideslip_max_deg": 1e-9, "altitude_error_max_m": 1e9}
    requirements = [
        f"{{metric: {metric}, below: {limit}, probability: {0.5 if 'speed' in metric else 0.9}}}"
        for metric, limit in metrics.items()
    ]
    for count, text in ((2, "2 of 3, max sideslip 60 of 60"), (5, "2 of 3")):
        names = ["tlc", "slow", "c", "b", "a"][:count]
        lines, models = judged(tmp_path / str(count), requirements, controllers=names)
        labels = ", ".join(map(models.names.label, sorted(names))) if count == 2 else "all"
        assert lines["Misses"] == [f"{labels}: {text}"]


@pytest.mark.parametrize("asks", ["drivers", "worst", "{compare: [lqr_retuned, tlc]}"])
def test_the_first_record_answers_the_question(tmp_path, asks):
    controllers = ["tlc", "lqr", "lqr_retuned"]
    requirements = [REQUIRED.format(limit=1e-9, probability=0.9)]
    lines, models = judged(tmp_path / "c", requirements, controllers=controllers, asks=asks)
    first = {"drivers": "Drivers", "worst": "Worst flight"}.get(asks, "Misses")
    assert next(iter(lines)) == first
    compared = " ".join(lines.get("Better in", []) + lines.get("Not beaten", []))
    assert ("LQR:" in compared or "LQR 1" in compared) <= ("compare" not in asks)
    flights = models.results.flights
    tlc, lqr = (flights[name].metrics["speed_error_max_mps"] for name in ("tlc", "lqr_retuned"))
    share = max(np.mean(tlc < lqr), np.mean(lqr < tlc))
    assert f"on {percent(share, 2)} of flights" in compared or "compare" not in asks
    assert f"paired {MINUS}" in compared or "compare" not in asks
    # The median of LQR is farther from that of TLC.
    assert re.search(r"speed error \([^;]*; LQR retuned ", compared)


def pair_of(a, b, winner):
    return SimpleNamespace(a=a, b=b, metrics={"m": SimpleNamespace(winner=winner)})


@pytest.mark.parametrize(
    ("winners", "winner", "not_beaten"),
    [
        (("a", "a", "b"), "a", ("a",)),
        (("a", None, "b"), None, ("a",)),  # a beats b and b beats c: a does not beat c
        (("a", None, None), None, ("a", "c")),
        (("a", "c", "b"), None, ()),  # a cycle
        ((None, None, None), None, ("a", "b", "c")),
    ],
)
def test_a_winner_beats_every_other_controller(winners, winner, not_beaten):
    pairs = [pair_of(*pair, who) for pair, who in zip(("ab", "ac", "bc"), winners, strict=True)]
    for names in ("abc", "cab"):
        standing = make_standings(pairs, list(names))["m"]
        assert (standing.winner, standing.not_beaten) == (winner, not_beaten)


@pytest.mark.parametrize(
    ("compare", "match"),
    [
        ("[tlc, lrq]", "'lrq'"),
        ("[tlc]", "at least 2"),
    ],
)
def test_a_question_about_other_controllers_is_rejected_with_its_place(tmp_path, compare, match):
    with pytest.raises(InputError, match=match):
        read_campaign(
            write_fake(
                tmp_path,
                controllers="{tlc: one.yaml, lqr: two.yaml}",
                asks=f"{{compare: {compare}}}",
            )
        )


LABELS = {"tlc": "TLC", "lqr": "LQR", "lqr_retuned": "LQR retuned"}
METRICS = ("altitude_error_max_m", "speed_error_max_mps", "sideslip_max_deg")
COUNTS = SimpleNamespace(flown=100, failed=0, not_computed=0)


class Given(Models):
    """Models of a campaign of 100 flights of three controllers, of which some are given."""

    def __init__(self, results, **given):
        super().__init__(results)
        counts = dict.fromkeys(LABELS, COUNTS)
        none = SimpleNamespace(requirements=(), held_together=None, binding=[])
        self.given = {
            "verdicts": none,
            "comparison": SimpleNamespace(pairs={}),
            "flights": SimpleNamespace(counts=counts, left_out={}),
            "margins": SimpleNamespace(steady=SimpleNamespace(controllers={}, corners=8), flown={}),
            **given,
        }

    def __getitem__(self, topic):
        return self.given.get(topic.name) or super().__getitem__(topic)


@pytest.fixture
def summarized(failing, monkeypatch):
    """Return a function that returns the entries of a summary with given models, by label."""
    monkeypatch.setattr(summary, "find_next_step", lambda _: None)
    monkeypatch.setattr(summary, "missing_margins", lambda *_: ["no margins"])

    def make(change=lambda models: None, **given):
        models = Given(given.pop("results", failing), **given)
        change(models)
        return {label: [clean(line) for line in lines] for label, lines in lines_of(models).items()}

    return make


def clean(text):
    return re.sub(r"\s", " ", text).replace(MINUS, "-")


def verdicts_of(own, **entries):
    """Return verdicts from the number of failures of 100 flights of each controller, by metric."""
    allowed = dict(zip(METRICS, (0.9, 0.99, 0.5), strict=True))
    made = {
        name: [(SimpleNamespace(metric=metric), verdict if hasattr(verdict, "status")
                else judge(verdict, 100, allowed[metric]))
               for metric, verdict in zip(METRICS, verdicts, strict=False)]
        for name, verdicts in own.items()
    }  # fmt: skip
    binding = [(item, name, verdict) for name in made for item, verdict in made[name]]
    given = {"requirements": [1], "held_together": None, "binding": binding, **entries}
    return SimpleNamespace(verdicts_of=made.get, **given)


def test_verdicts_are_counted_and_the_most_exceeded_requirement_is_named(summarized):
    needed = [flights_to_pass(failures, 0.99, 0.1) for failures in (0, 1)]
    lines = summarized(verdicts=verdicts_of({"tlc": (30, 60, 100), "lqr": (0, 0, 0),
                                             "lqr_retuned": (0, 1, 0)}))  # fmt: skip
    # of 10, 1 and 50 allowed failures, 30, 60 and 100 exceed the second the most
    assert lines["Misses"] == ["TLC: 3 of 3, max speed error 60 of 100"]
    assert lines["Not shown"] == ["LQR: 1 of 3, max speed error 0 of 100",
                                  "LQR retuned: 1 of 3, max speed error 1 of 100"]  # fmt: skip
    assert lines["Flights needed"] == [str(max(needed))] and needed[0] < needed[1]
    lines = summarized(verdicts=verdicts_of({"tlc": (0,), "lqr": (0, 50), "lqr_retuned": (0,)}))
    assert lines["Meets all 1 requirements"] == ["LQR retuned, TLC"] and "Not shown" not in lines
    later = replace(judge(0, 100, 0.5), note=SET_LATER)
    lines = summarized(verdicts=verdicts_of({"tlc": (later, 99), "lqr": (later,),
                                             "lqr_retuned": (0,)}))  # fmt: skip
    assert lines["PASS (set later)"] == ["LQR: 1 of 1, max altitude error 0 of 100",
                                         "TLC: 1 of 2, max altitude error 0 of 100"]  # fmt: skip
    assert list(lines).count("Meets all 1 requirements") == 1
    assert lines["Meets all 1 requirements"] == ["LQR retuned"] and "Flights needed" not in lines
    estimate = replace(judge(3, 100, 0.9), status="ESTIMATE")
    lines = summarized(verdicts=verdicts_of(dict.fromkeys(LABELS, (estimate,))))
    assert lines["Estimates, no verdicts"][0] == (
        "LQR, LQR retuned, TLC: 1 of 1, max altitude error 3 of 100"
    )
    own = {"tlc": (0,), "lqr": (0, judge(0, 999, 0.9)), "lqr_retuned": (0,)}
    two = summarized(verdicts=verdicts_of(own))
    met = [label for label in two if label.startswith("Meets")]
    assert met == ["Meets all 1 requirements", "Meets all 2 requirements"]
    assert summarized()["No requirements"] == [""]


def compared(a, b, winners, difference=0.25):
    entries = {
        metric: SimpleNamespace(winner=winner, a_better=70, b_better=20,
                                median_difference=Interval(difference, 0.0, 1.0))
        for metric, winner in zip(METRICS, winners, strict=True)
    }  # fmt: skip
    return SimpleNamespace(a=a, b=b, pairs=100, metrics=entries, losing=None)


def pairs_of(*winners):
    pairs = [("lqr", "lqr_retuned"), ("lqr", "tlc"), ("lqr_retuned", "tlc")]
    found = [compared(*pair, who) for pair, who in zip(pairs, winners, strict=True)]
    return SimpleNamespace(pairs={f"{pair.a} - {pair.b}": pair for pair in found})


def medians_of(*values):
    tables = {
        metric: SimpleNamespace(controllers={
            name: SimpleNamespace(quantiles={"q50": SimpleNamespace(value=value)})
            for name, value in zip(("tlc", "lqr", "lqr_retuned"), values, strict=True)})
        for metric in METRICS
    }  # fmt: skip
    return SimpleNamespace(table=tables)


def test_winners_are_compared_with_their_nearest_rival(summarized):
    """The median of LQR retuned is nearer to that of the other two than these to one another."""
    pairs = pairs_of(("lqr", None, "lqr"), ("tlc", "tlc", "lqr"), ("tlc", "tlc", None))
    lines = summarized(comparison=pairs, metrics=medians_of(1.0, 8.0, 4.0))
    assert lines["Better in"] == [
        "LQR: max sideslip (8.00 deg; LQR retuned 4.00 deg; paired 0.250 deg; on 70 % of flights)",
        "TLC: max altitude error (1.00 m; LQR retuned 4.00 m; paired -0.250 m; on 20 % of flights),"
        " max speed error (1.00 m/s; LQR retuned 4.00 m/s; paired -0.250 m/s; on 20 % of flights)",
    ]
    assert "Not beaten" not in lines
    assert "Better in" not in summarized()


def test_metrics_without_a_winner_name_those_not_beaten(summarized):
    def rename(models):
        records = {
            name: SimpleNamespace(phrase=letter)
            for name, letter in zip(METRICS, "ABC", strict=True)
        }
        models.names = replace(models.names, metrics={**models.names.metrics, **records})

    none = (None,) * 3
    pairs = pairs_of(("lqr", None, None), (None, "tlc", None), none)
    found = summarized(rename, comparison=pairs)["Not beaten"]
    assert found == ["no difference shown: C", "LQR, TLC: A", "LQR retuned, TLC: B"]
    pairs = pairs_of(("lqr", None, None), none, none)
    found = summarized(rename, comparison=pairs)["Not beaten"]
    assert found == ["no difference shown: B, C", "LQR, TLC: A"]
    cycle = pairs_of(("lqr", None, None), ("tlc", None, None), ("lqr_retuned", None, None))
    found = summarized(rename, comparison=cycle)["Not beaten"]
    assert "no order: LQR, LQR retuned, TLC (A)" in found


def test_early_terminations_name_all_that_have_fewer(summarized):
    counts = {name: SimpleNamespace(flown=100, failed=failed, not_computed=0)
              for name, failed in zip(LABELS, (0, 20, 7), strict=True)}  # fmt: skip
    pairs = pairs_of(*[(None,) * 3] * 3)
    for pair, losing in zip(pairs.pairs.values(), ("lqr", "lqr", None), strict=True):
        pair.losing = losing
    flights = SimpleNamespace(counts=counts, left_out={})
    lines = summarized(comparison=pairs, flights=flights)["Early terminations"]
    assert lines == ["LQR: 20 of 100, more than LQR retuned, TLC", "LQR retuned: 7 of 100"]


def steady(gain, phase, unstable=0, stable=True, fault=None):
    rows = [SimpleNamespace(gain_db=gain, loop="bank", phase_margin_deg=phase, counts=True)]
    nominal = [*rows, SimpleNamespace(stable=stable)]
    return SimpleNamespace(fault=fault, nominal=nominal, corners_unstable=unstable)


@pytest.mark.parametrize(
    ("entry", "text", "poor"),
    [
        (steady(20.0, 80.0), "20.0 dB (bank), 80 deg (bank)", False),
        (steady(20.0, 80.0, unstable=3), "20.0 dB (bank), 80 deg (bank)", True),
        (steady(2.0, 80.0), "2.0 dB (bank), 80 deg (bank)", True),
        (steady(np.inf, None), "no limit", False),
        (steady(2.0, 8.0, stable=False), "unstable", True),
        (steady(2.0, 8.0, fault="no trim"), None, False),
    ],
)
def test_margins_are_listed_if_poor_or_asked_for(summarized, failing, entry, text, poor):
    corners = SimpleNamespace(controllers={"tlc": entry}, corners=8)
    margins = SimpleNamespace(steady=corners)
    found = summarized(margins=margins)
    assert ("Margins" in found) == poor
    model = failing.campaign.model.model_copy(update={"asks": "margins"})
    asked = replace(failing, campaign=replace(failing.campaign, model=model))
    lines = summarized(margins=margins, results=asked).get("Least margins", [])
    assert [line.partition(" (customary")[0] for line in lines] == (
        [f"TLC: {text}"] if text else [])  # fmt: skip
    if lines and text != "unstable":
        assert "(customary 6 dB, " in lines[0]
        assert lines[0].endswith("unstable at 3 of 8 corners") == bool(entry.corners_unstable)


def test_the_risk_counts_the_verdicts_that_hold_jointly(summarized):
    asked = [SimpleNamespace(asked=SimpleNamespace(consumer_risk=risk)) for risk in (0.1, 0.2)]
    for stand, dropped, lines in ((3, (1, 2), ["20 % for each PASS; 3 of 5 PASS hold jointly"]),
                                  (0, (), None)):  # fmt: skip
        joint = SimpleNamespace(stand=stand, dropped=dropped)
        own = dict.fromkeys(LABELS, (0,))
        verdicts = verdicts_of(own, requirements=asked, held_together=joint)
        assert summarized(verdicts=verdicts).get("Risk") == lines


def test_missing_flights_are_counted(summarized, failing):
    counts = {
        **dict.fromkeys(LABELS, COUNTS),
        "lqr": SimpleNamespace(flown=98, failed=0, not_computed=2),
    }
    flights = SimpleNamespace(counts=counts, left_out={"pid": 50, "a": 40})
    found = ["a: 40 of 40 failed to run", "pid: 50 of 50 failed to run",
             "LQR: 2 of 100 failed to run"]  # fmt: skip
    for state, file_runs, first in (
        ("complete", 100, []),
        ("complete", None, []),
        ("complete", 120, ["100 of 120 flights computed"]),
        ("interrupted", 120, ["30 of 110 flights computed, interrupted"]),
    ):
        manifest = replace(failing.manifest, state=state, file_runs=file_runs, runs_done=30,
                           runs_planned=110)  # fmt: skip
        results = replace(failing, manifest=manifest)
        assert summarized(results=results, flights=flights)["Missing"] == [*first, *found]
    assert "Missing" not in summarized()


def test_the_next_step_has_its_command_first_and_its_assumption_last(summarized, monkeypatch):
    for step, line in (
        (NextStep("why", "fly DIR", "if"), "`fly DIR`: why (if)"),
        (NextStep("why"), "why"),
        (None, None),
    ):
        monkeypatch.setattr(summary, "find_next_step", lambda _, step=step: step)
        assert summarized().get("Next") == (line and [line])


def test_requirements_changed_after_results_are_listed(summarized, failing):
    results = replace(failing, requirement_changes=("x", "y"), changed_after=12000)
    found = summarized(results=results)["Changed after results"]
    assert found == ["12 000 flights known: x", "12 000 flights known: y"]


@pytest.mark.parametrize(
    ("few", "lines"),
    [
        ((), ["all: 5 of 9"]),
        (("c5",), ["all but C5: 5 of 9", "C5: 6 of 9"]),
        (("c3", "c4", "c5"), ["C0, C1, C2: 5 of 9", "C3, C4, C5: 6 of 9"]),
    ],
)
def test_entries_on_most_controllers_name_the_exceptions(summarized, few, lines):
    labels = {f"c{k}": f"C{k}" for k in range(6)}
    counts = {name: SimpleNamespace(flown=9, failed=5 + (name in few), not_computed=0)
              for name in labels}  # fmt: skip
    flights = SimpleNamespace(counts=counts, left_out={})

    def rename(models):
        models.names = replace(models.names, controllers=labels)

    assert summarized(rename, flights=flights)["Early terminations"] == lines


def test_the_worst_flight_has_its_metric_or_its_end(summarized, failing):
    model = failing.campaign.model.model_copy(update={"asks": "worst"})
    results = replace(failing, campaign=replace(failing.campaign, model=model))
    large = [SimpleNamespace(parameter="aero.lift", value=1.1),
             SimpleNamespace(parameter="aero.drag", value=0.9)]  # fmt: skip
    first = SimpleNamespace(
        flight=7,
        outcome="ok",
        missed=2,
        by="sideslip_max_deg",
        metrics={"sideslip_max_deg": 1.234, METRICS[0]: 9.0},
        largest=large,
    )
    ended = SimpleNamespace(flight=8, outcome="sideslip_limit", missed=3, by=None, metrics={},
                            largest=large[:1])  # fmt: skip
    worst = {"tlc": (first, ended), "lqr": (ended, first), "lqr_retuned": (ended,)}
    flights = SimpleNamespace(counts=dict.fromkeys(LABELS, COUNTS), left_out={}, worst=worst)
    lines = summarized(results=results, flights=flights)["Worst flight"]
    assert lines == [
        "LQR: flight 8, sideslip limit (lift +10.0 %)",
        "LQR retuned: flight 8, sideslip limit (lift +10.0 %)",
        "TLC: flight 7, max sideslip 1.23 deg (lift +10.0 %, drag -10.0 %)",
    ]


def basis(failing, monkeypatch, warnings=(), model=None, **entries):
    monkeypatch.setattr(summary, "missing_margins", lambda *_: ["no margins"])
    given = {key: entries.pop(key) for key in ("verdicts", "flights") if key in entries}
    campaign = replace(failing.campaign, **entries)
    if model:
        campaign = replace(campaign, model=campaign.model.model_copy(update=model))
    manifest = replace(failing.manifest, warnings=["early"], not_made=["late"])
    models = Given(replace(failing, campaign=campaign, manifest=manifest), **given)
    return {record.label: [clean(entry.line) for entry in record.entries]
            for record in confidence_records(models, warnings).records}  # fmt: skip


def test_the_basis_of_the_intervals_is_stated(failing, monkeypatch):
    counts = {"a": COUNTS, "b": SimpleNamespace(flown=9), "c": COUNTS}
    flights = SimpleNamespace(counts=counts)
    found = basis(failing, monkeypatch, ["late", "new"], flights=flights)
    assert found["Flights"] == ["9, 100 of each controller"]
    assert "95 %" in found["Intervals"][0]
    assert re.findall(r"[\d.]+ %", found["Risk of the comparison"][0]) == ["5 %", "5 %"]
    assert found["Note"] == ["early", "late", "no margins", "new"]
    assert not {"Unknowns", "Estimates", "Risk of a PASS", "Stops at", "Other seeds"} & set(found)
    asked = [SimpleNamespace(asked=SimpleNamespace(consumer_risk=risk)) for risk in (0.1, 0.2)]
    verdicts = SimpleNamespace(requirements=asked, held_together=object())
    found = basis(failing, monkeypatch, verdicts=verdicts, model={"stop": "proven"})
    assert found["Risk of a PASS"][0].startswith("20 %") and " 100 flights" in found["Stops at"][0]
    monkeypatch.setattr(summary, "suggest_merge", lambda *_: ("two folders", "abhv-mc merge"))
    noisy = SimpleNamespace(is_evidence=False)
    found = basis(failing, monkeypatch, repeatability=noisy)
    assert found["Other seeds"] == ["two folders", "`abhv-mc merge`"]


@pytest.mark.parametrize(("shared", "judged"), [(None, 4), (3, 3), (4, 4)])
def test_unknowns_state_their_flights_and_how_many_values_a_verdict_covers(
    failing, monkeypatch, shared, judged
):
    unknowns = replace(failing.campaign.unknowns, shared=shared, points=np.zeros((4, 1)))
    if not unknowns.names:
        unknowns = SimpleNamespace(names=("x",), points=np.zeros((4, 1)), shared=shared)
    found = basis(failing, monkeypatch, unknowns=unknowns)["Unknowns"]
    assert re.findall(r"\d+", found[0]) == ["25", "4", str(judged), "4"] and len(found) == 2
    assert ("most failures" in found[0]) == (judged < 4)


TWO = "[{metric: altitude_error_max_m, below: 50, probability: 0.9973}, \
{metric: sideslip_max_deg, below: 1, probability: 0.99}]"


def plan(folder, **entries):
    return json_data(
        plan_campaign(
            read_campaign(write_fake(folder, **{"requirements": TWO, "runs": "1000", **entries}))
        )
    )


def test_flights_for_failures_and_chances(tmp_path):
    numbers = plan(tmp_path)
    first, second = numbers["requirements"]
    assert first["flights_for_failures"] == {"0": 981, "1": 2235, "2": 3086, "3": 3831}
    assert (first["most_failures_at_runs"], second["most_failures_at_runs"]) == (0, 2)
    at_limit, fifth = (numbers["rates_over_allowed"].index(rate) for rate in (1.0, 0.2))
    for entry in (first, second):
        assert [chance["runs"] for chance in entry["pass_chance"]] == [1000, 2000, 4000]
        for chance in entry["pass_chance"]:
            assert chance["at_some_flight"][0] == 1.0 and chance["at_some_flight"][at_limit] <= 0.1
            assert all(
                repeated >= once - 1e-12
                for repeated, once in zip(chance["at_some_flight"], chance["at_runs"], strict=True)
            )
    assert first["pass_chance"][0]["at_runs"][fifth] == pytest.approx(
        binom.cdf(0, 1000, 0.2 * 0.0027)
    )
    low, high = (numbers["together"][0]["at_runs"][end][10] for end in ("low", "high"))
    assert 0.0 <= low <= high <= first["pass_chance"][0]["at_runs"][10] + 1e-12


def test_a_family_needs_more_flights(tmp_path):
    numbers = plan(tmp_path, family="{risk: 0.1}")
    assert (
        numbers["requirements"][0]["flights_for_failures"]["0"] > 981
        and numbers["family_risk"] == 0.1
    )


def test_the_plan_counts_the_flights_of_the_search(tmp_path):
    """Of 2 unknowns, 2 controllers and 2 requirements, with 80 flights at each value."""
    unknowns = "{aero.lift: {low: 0.9, high: 1.1}, aero.drag: {low: 0.8, high: 1.15}}"
    density = "{atmosphere.density: {distribution: uniform, half_width: 10 %}}"
    numbers = plan(tmp_path, unknowns=unknowns, dispersions=density, runs="80")
    assert (numbers["runs"], numbers["most_points"]) == (80, 4 + 1 + 2 * 2 * 2)
    assert numbers["search_flights"] == 2 * 80 * (4 + 1 + 32 + 2 * 64)


def test_the_plan_shares_a_joint_risk_and_bounds_the_joint_chance(tmp_path):
    """Each of four verdicts has a quarter of the joint risk, if that is less than its own."""
    plain = plan(tmp_path / "plain")
    rates = plain["rates_over_allowed"]
    assert (rates[0], rates[-1], len(rates)) == (0.0, 3.0, 25) and np.all(np.diff(rates) > 0.0)
    assert {0.02, 0.2, 1.0} <= set(np.round(rates, 12))
    assert (plain["verdicts"], plain["family_risk"], plain["most_points"]) == (4, None, 1)
    assert plain["independent_flights"] and not plain["stops_when_proven"]
    assert [entry["risk_used"] for entry in plain["requirements"]] == [0.1, 0.1]
    for k, joint in enumerate(plain["together"]):
        assert joint["runs"] == (1000, 2000, 4000)[k]
        for kind in ("at_some_flight", "at_runs"):
            chances = np.array([entry["pass_chance"][k][kind] for entry in plain["requirements"]])
            np.testing.assert_allclose(joint[kind]["high"], chances.min(axis=0), atol=1e-12)
            low = np.maximum(chances.sum(axis=0) - 1.0, 0.0)
            np.testing.assert_allclose(joint[kind]["low"], low, atol=1e-12)
    for k, entry in enumerate(plain["requirements"]):
        allowed = 1.0 - (0.9973, 0.99)[k]
        for chance in entry["pass_chance"]:
            most = most_failures(chance["runs"], 1.0 - allowed, 0.1)
            expected = binom.cdf(most, chance["runs"], allowed * np.array(rates))
            np.testing.assert_allclose(chance["at_runs"], expected, atol=1e-9)
    joint = plan(tmp_path / "joint", family="{risk: 0.1}", sampling="lhs")
    assert [entry["risk_used"] for entry in joint["requirements"]] == [0.025, 0.025]
    assert not joint["independent_flights"]
    generous = plan(tmp_path / "generous", family="{risk: 0.49}")
    assert [entry["risk_used"] for entry in generous["requirements"]] == [0.1, 0.1]
