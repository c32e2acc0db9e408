"""Recommended next step of a campaign."""

import re
from dataclasses import replace
from types import SimpleNamespace

import pytest
from report.synthetic import write_campaign

from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.report.numbers.next_step import find_next_step, flights_for_joint_verdicts
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.family import hold_family
from abhv_mc.statistics.verdicts import SET_LATER, UNSEARCHED, about, judge, predict_pass
from abhv_mc.topics.formatting import fixed
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS

ENTRY = "{{metric: speed_error_max_mps, below: {}, probability: {}, consumer_risk: 0.1}}"
UNKNOWN = {
    "dispersions": "{atmosphere.density: {distribution: uniform, half_width: 10 %}}",
    "unknowns": "{aero.drag: {low: -15 %, high: 15 %}}",
    "points": "{at: {aero.drag: [0.85, 1.0, 1.15]}}",
}
LEAST, AFTER_ONE = flights_to_pass(0, 0.98, 0.1), flights_to_pass(1, 0.9973, 0.1)
TWO = [ENTRY.format(1e6, probability) for probability in (0.99, 0.9991714)]
ONE_LOST = {
    "controllers": ["tlc", "lqr"],
    "failing": 1,
    "requirements": [ENTRY.format(1e6, 0.9973).replace("}", ", controllers: [lqr]}")],
}


def read(folder, limit, probability, **keys):
    keys = {"requirements": [ENTRY.format(limit, probability)], "controllers": ["tlc"], **keys}
    return Models(read_flown(write_campaign(folder, **keys)))


def changed(models, **entries):
    return find_next_step(Models(replace(models.results, **entries)))


@pytest.mark.parametrize(
    ("limit", "probability", "keys", "command", "reason"),
    [
        (1e6, 0.5, {}, "", "none"),
        (1e6, 0.98, {}, "--runs", "all PASS"),
        (1e6, 0.999999, {}, "", "at least"),  # more than a hundred times the flights are needed
        (1e6, 0.9973, {"runs": 32}, f"--runs {flights_to_pass(0, 0.9973, 0.1)}", fixed(981, 0)),
        # The least number of flights is 10 times the present number or one more, and 100 times.
        (1e6, 0.99174, {"runs": 32}, "", "320"),
        (1e6, 0.99176, {"runs": 32}, "--runs 321", "321"),
        (1e6, 0.9991714, {"runs": 32}, "--runs 3200", fixed(3200, 0)),
        (1e6, 0.9991716, {"runs": 32}, "", fixed(3201, 0)),
        (1e6, 0.0, {"runs": 32, "requirements": TWO}, "--runs 3200", fixed(3200, 0)),
        (1e6, 0.9973, {"runs": 32, **ONE_LOST}, f"--runs {AFTER_ONE}", fixed(AFTER_ONE, 0)),
        (1e-9, 0.9, {}, "explain DIR --all", ""),
        (1e6, 0.98, {"runs": 60, **UNKNOWN}, f"--runs {LEAST}", f"{LEAST} flights at each point"),
        (1e-9, 0.9, {"runs": 60, **UNKNOWN}, "explain DIR --all", ""),
        (1e6, 0.5, {"requirements": []}, "run CAMPAIGN.yaml -o DIR", "add requirements"),
    ],
)
def test_the_next_step_has_a_command_and_a_reason(
    tmp_path, limit, probability, keys, command, reason
):
    step = find_next_step(read(tmp_path / "c", limit, probability, **keys))
    assert step.command.endswith(command) if command != "--runs" else command in step.command
    assert reason in step.why and bool(step.command) == bool(command)
    assert ("Jeffreys" in step.assumption) == bool(re.search("%|unlikely", step.why))


@pytest.mark.parametrize("limit", [1e6, 1e-9])
def test_a_partly_run_campaign_is_first_completed(tmp_path, limit):
    """Regression: advice was to explain failures, or to run more flights for joint verdicts."""
    models = read(tmp_path / "c", limit, 0.5)
    longer = replace(models.results.manifest, file_runs=2100)
    step = changed(models, manifest=longer)
    assert step.command == "abhv-mc run DIR/campaign.yaml -o DIR --runs 2100"
    assert "60 of 2100" in step.why
    stopped = replace(models.results.manifest, state="interrupted", runs_done=20, runs_planned=60)
    step = changed(models, manifest=stopped)
    assert step.command.endswith("--runs 60") and "20 of 60" in step.why
    assert "--runs" not in changed(models).command


@pytest.mark.parametrize(
    ("limit", "probability", "is_campaign", "command"),
    [
        (1e-9, 0.9, True, "abhv-mc run 'other file.yaml' -o DIR"),
        (1e-9, 0.9, False, "abhv-mc run CAMPAIGN.yaml -o DIR"),
        (1e6, 0.98, True, "&& abhv-mc report DIR --requirements 'other file.yaml' -o OUT"),
    ],
)
def test_another_requirement_file_is_named(tmp_path, limit, probability, is_campaign, command):
    entries = {"judged_by": "other file.yaml", "judged_by_campaign": is_campaign}
    step = changed(read(tmp_path / "c", limit, probability), **entries)
    assert step.command.endswith(command)


def test_requirements_set_later_are_confirmed_by_another_seed(tmp_path):
    models = read(tmp_path / "c", 1e6, 0.5)
    campaign = replace(models.results.campaign, later_choices=frozenset({(0, "tlc")}))
    step = changed(models, campaign=campaign)
    assert step.command.endswith(f"--seed {campaign.seed + 1}") and "set later" in step.why
    pooled = campaign.model.model_copy(update={"pooled": [SimpleNamespace(seed=9999)]})
    assert "--seed 10000" in changed(models, campaign=replace(campaign, model=pooled)).command


def test_unsearched_worst_values_need_a_new_folder_not_more_flights(tmp_path):
    models = read(tmp_path / "c", 1e6, 0.5, runs=60, **UNKNOWN)
    unknowns = replace(models.results.campaign.unknowns, unsearched=frozenset({0}))
    step = changed(models, campaign=replace(models.results.campaign, unknowns=unknowns))
    assert "folder" in step.why and not step.command


def test_flights_jointly_would_let_every_pass_stand(tmp_path):
    verdicts = read(tmp_path / "c", 1e6, 0.95, runs=60, controllers=["tlc", "lqr"])[VERDICTS]
    assert verdicts.held_together.dropped
    flights = flights_for_joint_verdicts(verdicts)
    for runs, stand in ((flights, True), (flights - 1, False)):
        verdicts_after = hold_family(
            [judge(0, runs, 0.95)] * verdicts.held_together.verdicts, verdicts.held_together.risk
        )
        assert all(verdict.status == "PASS" for verdict in verdicts_after) is stand
    # Holm's procedure gives the verdict with the larger p-value the whole risk.
    own = {"a": judge(0, 400, 0.95), "b": judge(3, 400, 0.95)}
    joint = SimpleNamespace(dropped=((0, "b"),), risk=0.1, verdicts=2)
    for names in ("ab", "ba"):
        entry = SimpleNamespace(controllers={name: own[name] for name in names})
        stub = SimpleNamespace(held_together=joint, requirements=[entry])
        assert flights_for_joint_verdicts(stub) == flights_to_pass(3, 0.95, 0.1)


def test_a_controller_without_flights_is_not_decided(tmp_path):
    both = ENTRY.format(1e6, 0.5).replace("}", ", controllers: [tlc, lqr]}")
    keys = {"controllers": ["tlc", "lqr"], "requirements": [both]}
    models = read(tmp_path / "c", 1e6, 0.5, **keys)
    assert find_next_step(models).why.startswith("none")
    assert changed(models, flights={"tlc": models.results.flights["tlc"]}) is None


class Stub:
    """Models of a complete campaign of 100 flights with given verdicts."""

    def __init__(self, verdicts, manifest=(), **campaign):
        self.verdicts = verdicts
        facts = {"can_rerun": True, "runs_at_point": 100, "judged": True, "seed": 7,
                 "pooled_seeds": (), "unknowns": SimpleNamespace(names=())}  # fmt: skip
        sources = {key: campaign.pop(key, "") for key in ("judged_by", "judged_by_campaign")}
        stated = {"file_runs": 100, "state": "complete", "runs_done": 100, "runs_planned": 100}
        self.results = SimpleNamespace(
            campaign=SimpleNamespace(**{**facts, **campaign}),
            manifest=SimpleNamespace(**{**stated, **dict(manifest)}),
            **sources,
        )
        self.names = SimpleNamespace(label=str.upper, campaign=self.results.campaign)

    def __getitem__(self, topic):
        verdicts = self.verdicts
        joint = SimpleNamespace(dropped=())
        binding = [(None, name, verdict) for name, verdict in verdicts]
        return SimpleNamespace(requirements=verdicts, binding=binding, held_together=joint)


PASS, FAIL = judge(0, 5000, 0.9), judge(50, 100, 0.99)
LATER = replace(PASS, note=SET_LATER)
OPEN = judge(0, 100, 0.97)


@pytest.mark.parametrize(
    ("verdicts", "entries", "command", "imported"),
    [
        ([("b", FAIL), ("a", PASS)], {}, "explain DIR --all", ""),
        ([("b", FAIL)], {"judged_by": "r.yaml"}, "run CAMPAIGN.yaml -o DIR", ""),
        ([("b", FAIL)], {"judged_by": "r.yaml", "judged_by_campaign": True},
         "run r.yaml -o DIR", ""),
        ([("b", PASS), ("a", LATER)], {}, "run DIR/campaign.yaml -o DIR-confirmed --seed 8", ""),
        ([("b", LATER)], {"pooled_seeds": (3, 20), "judged_by": "r.yaml"},
         "run CAMPAIGN.yaml -o DIR-confirmed --seed 21", ""),
        ([], {}, "run CAMPAIGN.yaml -o DIR", None),
        ([("b", FAIL)], {"judged": False}, None, None),
        ([("b", PASS), ("a", None)], {}, None, None),
        ([("b", PASS), ("a", PASS)], {}, "", ""),
        ([("b", replace(OPEN, note=UNSEARCHED)), ("a", OPEN)], {}, "", ""),
        ([("b", PASS)], {"manifest": {"file_runs": 400}},
         "run DIR/campaign.yaml -o DIR --runs 400", ""),
        ([("b", PASS)], {"manifest": {"state": "interrupted", "runs_done": 30}},
         "run DIR/campaign.yaml -o DIR --runs 100", ""),
        ([("b", PASS)], {"manifest": {"file_runs": None}}, "", ""),
        ([("b", PASS)], {"manifest": {"file_runs": 20}}, "", ""),
    ],
)  # fmt: skip
def test_a_step_has_its_command_unless_the_table_is_imported(verdicts, entries, command, imported):
    for flies, expected in ((True, command), (False, imported)):
        step = find_next_step(Stub(verdicts, can_rerun=flies, **entries))
        if expected is None:
            assert step is None
        else:
            assert step.command.removeprefix("abhv-mc ") == expected


def test_the_reason_names_counts_or_the_decided_controllers():
    assert find_next_step(Stub([("b", PASS), ("a", PASS)])).why.endswith(" for A, B")
    partial = {"state": "interrupted", "runs_done": 30, "runs_planned": 60, "file_runs": None}
    assert "30 of 60 flights" in find_next_step(Stub([], partial)).why
    assert "100 of 400 flights" in find_next_step(Stub([], {**partial, "file_runs": 400})).why


def test_the_least_flights_are_those_of_the_most_demanding_open_verdict():
    """Ten times the present number of flights are 1000, the most that is tried for a chance."""
    first, second = judge(0, 100, 0.999), judge(1, 60, 0.9982)
    least = [flights_to_pass(0, 0.999, 0.1), flights_to_pass(1, 0.9982, 0.1)]
    chance = min(predict_pass(verdict, max(least)) for verdict in (first, second))
    assert max(least) == least[1] > least[0] > 1000
    assert about(chance) != about(predict_pass(first, max(least)))
    for order in ((first, second), (second, first)):
        step = find_next_step(Stub([("a", verdict) for verdict in order]))
        assert fixed(max(least), 0) in step.why and step.why.endswith(about(chance))
        assert step.command.endswith(f"--runs {max(least)}")
        imported = find_next_step(Stub([("a", verdict) for verdict in order], can_rerun=False))
        assert imported.why.startswith("import ") and fixed(max(least), 0) in imported.why
