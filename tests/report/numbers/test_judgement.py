"""Assessment of a campaign with its next step, and chances of PASS of a planned campaign."""

import re
from dataclasses import replace

import numpy as np
import pytest
from fake_flight import write_campaign as write_fake
from report.synthetic import build_page, write_campaign
from scipy.stats import binom

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.input_error import InputError
from abhv_mc.report.numbers.judgement import (
    ALONE,
    NO_DIFFERENCE,
    flights_for_joint_verdicts,
    judge_campaign,
)
from abhv_mc.report.numbers.judgement_record import read_judgement
from abhv_mc.report.numbers.pass_chances import plan_campaign
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.family import hold_family
from abhv_mc.statistics.verdicts import judge
from abhv_mc.topics.formatting import fixed, percent
from abhv_mc.topics.json_data import json_data
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS

REQUIRED = (
    "{{metric: speed_error_max_mps, below: {limit}, probability: {probability}, "
    "consumer_risk: 0.1}}"
)


def judged(folder, requirements, **keys):
    keys = {"controllers": ["tlc", "lqr"], **keys}
    models = Models(read_flown(write_campaign(folder, requirements=requirements, **keys)))
    return judge_campaign(models), models


@pytest.mark.parametrize(
    ("limit", "probability", "met", "command"),
    [
        (1e6, 0.5, "yes", ""),
        (1e6, 0.98, "not shown", "--runs"),
        (1e6, 0.999999, "not shown", ""),  # more than ten times the flights are needed
        (1e-9, 0.9, "no", "explain DIR --all"),
    ],
)
def test_what_is_met_and_what_would_help(tmp_path, limit, probability, met, command):
    judgement, _ = judged(tmp_path / "c", [REQUIRED.format(limit=limit, probability=probability)])
    assert judgement.met == met
    assert command in judgement.next.command
    assert (judgement.next.command == "") == (command == "")


def test_the_stored_judgement_is_the_same(tmp_path):
    folder = tmp_path / "c"
    judgement, _ = judged(folder, [REQUIRED.format(limit=1e6, probability=0.99)])
    build_page(folder)
    manifest = read_flown(folder).manifest
    assert read_judgement(folder, manifest) == judgement
    assert (
        read_judgement(folder, replace(manifest, digest="another"))
        is read_judgement(tmp_path, manifest)
        is None
    )


def test_flights_jointly_would_let_every_pass_stand(tmp_path):
    _, models = judged(tmp_path / "c", [REQUIRED.format(limit=1e6, probability=0.95)], runs=60)
    verdicts = models[VERDICTS]
    assert verdicts.held_together.dropped
    flights = flights_for_joint_verdicts(verdicts)
    for runs, stand in ((flights, True), (flights - 1, False)):
        verdicts_after = hold_family(
            [judge(0, runs, 0.95)] * verdicts.held_together.verdicts, verdicts.held_together.risk
        )
        assert all(verdict.status == "PASS" for verdict in verdicts_after) is stand


def test_lost_flights_lead_what_is_better(tmp_path):
    requirements = [REQUIRED.format(limit=1e6, probability=0.5)]
    judgement, _ = judged(tmp_path / "c", requirements, failing=20)
    assert judgement.better == "tlc" and len(judgement.because) <= 3
    assert re.search(r"\bTLC\b[^.]*\bLQR: 0 \w+ 20 of 60\b", judgement.answer)
    assert judged(tmp_path / "one", requirements, controllers=["tlc"])[0].better == ALONE
    assert (
        judged(tmp_path / "lhs", requirements, sampling="lhs", runs=16)[0].better == NO_DIFFERENCE
    )


def test_the_answer_names_who_meets_everything_and_who_misses_what(tmp_path):
    """Regression: the answer did not say that another controller meets all requirements."""
    limits = [REQUIRED.format(limit=1e6, probability=0.5)]
    judgement, models = judged(tmp_path / "all", limits)
    assert judgement.met == "yes" and re.match(r"TLC \w+ LQR\b[^.:]*\. ?", judgement.answer)
    values = models.results.flights
    worst = {
        name: np.sort(flights.metrics["speed_error_max_mps"]) for name, flights in values.items()
    }
    order = sorted(worst, key=lambda name: worst[name][30])
    limit = float(worst[order[0]][-1] + 1e-6)  # met by one in all flights, and missed by the other
    judgement, _ = judged(tmp_path / "one", [REQUIRED.format(limit=limit, probability=0.9)])
    clauses = re.fullmatch(r"(TLC [^;]*); (LQR .*?)\.( .*)?", judgement.answer)
    has_counts = ["(" in clause for clause in clauses.groups()[:2]]  # of who misses it
    assert has_counts == [order[0] != "tlc", order[0] == "tlc"]
    phrase = models.names.metrics["speed_error_max_mps"].phrase
    assert order[0] == "tlc" or phrase in clauses[1]


@pytest.mark.parametrize(
    ("limit", "met"),
    [
        (1e-9, "no"),
        (1e6, "not shown"),
    ],
)
def test_that_nobody_meets_the_requirements_is_said(tmp_path, limit, met):
    """Regression: a third controller, which the question does not name, was left out."""
    requirements = [REQUIRED.format(limit=limit, probability=0.999)]
    judgement, _ = judged(
        tmp_path / "c",
        requirements,
        controllers=["tlc", "lqr", "lqr_retuned"],
        asks="{compare: [tlc, lqr]}",
    )
    assert judgement.met == met
    assert re.match(r"(?!TLC|LQR)[^:]*: TLC ", judgement.answer)  # all, then each


@pytest.mark.parametrize(
    ("asks", "begins"),
    [
        ("drivers", r"[^.:]*\bdrivers\b[^.:]* TLC: "),
        ("worst", r"[^.:]*\bworst\b[^.:]* TLC, "),
        ("{compare: [tlc, lqr_retuned]}", r"(?!TLC|LQR)[^:]*: TLC "),
    ],
)
def test_the_first_sentence_answers_the_question(tmp_path, asks, begins):
    controllers = ["tlc", "lqr", "lqr_retuned"]
    requirements = [REQUIRED.format(limit=1e-9, probability=0.9)]
    judgement, _ = judged(tmp_path / "c", requirements, controllers=controllers, asks=asks)
    assert re.match(begins, judgement.answer)
    first = judgement.answer.partition(". ")[0]
    assert ("LQR retuned" in first) == ("compare" in asks)
    assert not re.search(r"\bLQR\b(?! retuned)", first)


@pytest.mark.parametrize(
    ("compare", "match"),
    [
        ("[tlc, lrq]", "'lrq'"),
        ("[lqr, tlc]", "'tlc', the campaign's first"),
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


def test_the_answer_names_two_missed_requirements_and_every_controller(tmp_path):
    """Regression: a controller that does not determine the exit code was left out."""
    metrics = {"speed_error_max_mps": 1e-9, "sideslip_max_deg": 1e-9, "altitude_error_max_m": 1e9}
    requirements = [
        f"{{metric: {metric}, below: {limit}, probability: 0.9}}"
        for metric, limit in metrics.items()
    ]
    judgement, _ = judged(tmp_path / "c", requirements, controllers=["tlc", "slow"])
    words = judgement.answer.replace("'slow'", "SLOW")
    for text in ("TLC and SLOW", "2 of 3", "max speed error", "max sideslip"):
        assert text in words
    assert "slow" not in words


def test_risks_are_stated_only_for_verdicts_and_winners_that_exist(tmp_path):
    judgement, _ = judged(tmp_path / "c", [REQUIRED.format(limit=1e-9, probability=0.9)])
    assert "PASS" not in judgement.sure
    assert ("winner" in judgement.sure) == (judgement.better in ("tlc", "lqr"))


def test_fewer_flights_than_the_file_asks_for_are_said_first(tmp_path):
    requirements = [REQUIRED.format(limit=1e6, probability=0.5)]
    judgement, models = judged(tmp_path / "c", requirements)
    manifest = replace(models.results.manifest, file_runs=2100)
    judgement = judge_campaign(Models(replace(models.results, manifest=manifest)))
    assert re.match(r"60 of 2100 flights ", judgement.answer)
    assert judgement.next.command == "abhv-mc run DIR/campaign.yaml -o DIR --runs 2100"
    enough = replace(manifest, file_runs=60)
    judgement = judge_campaign(Models(replace(models.results, manifest=enough)))
    assert "60 of 60" not in judgement.answer and not re.match(r"\d", judgement.answer)


UNKNOWN = {
    "dispersions": "{atmosphere.density: {distribution: uniform, half_width: 10 %}}",
    "unknowns": "{aero.drag: {low: -15 %, high: 15 %}}",
    "points": "{at: {aero.drag: [0.85, 1.0, 1.15]}}",
}


@pytest.mark.parametrize(
    ("limit", "probability", "command", "number"),
    [
        (1e6, 0.98, f"--runs {flights_to_pass(0, 0.98, 0.1)}", str(flights_to_pass(0, 0.98, 0.1))),
        (1e6, 0.5, "", ""),
        (1e-9, 0.9, "explain DIR --all", ""),
    ],
)
def test_a_campaign_with_unknowns_has_a_next_step(tmp_path, limit, probability, command, number):
    """Regression: no next step was named, not even a sufficient number of flights."""
    requirements = [REQUIRED.format(limit=limit, probability=probability)]
    judgement, models = judged(tmp_path / "c", requirements, runs=60, **UNKNOWN)
    assert models.results.campaign.unknowns.names == ("aero.drag",)
    assert judgement.next.command.endswith(command) and number in judgement.next.why
    assert bool(judgement.next.command) == bool(command)
    assert ("point" in judgement.next.why) == bool(number)


def test_without_requirements_the_next_step_is_to_add_some(tmp_path):
    judgement, _ = judged(tmp_path / "c", [], controllers=["tlc"])
    assert judgement.met == "nothing required" and "requirements" in judgement.next.why


def test_unsearched_worst_values_need_a_new_folder_not_more_flights(tmp_path):
    requirements = [REQUIRED.format(limit=1e6, probability=0.5)]
    _, models = judged(tmp_path / "c", requirements, runs=60, **UNKNOWN)
    unknowns = replace(models.results.campaign.unknowns, unsearched=frozenset({0}))
    campaign = replace(models.results.campaign, unknowns=unknowns)
    judgement = judge_campaign(Models(replace(models.results, campaign=campaign)))
    assert judgement.met == "not shown" and "folder" in judgement.next.why
    assert "--runs" not in judgement.next.command


@pytest.mark.parametrize(("probability", "flights"), [(0.9973, 981), (0.999999, None)])
def test_far_too_few_flights_name_the_least_number(tmp_path, probability, flights):
    """Regression: the next step said only how many flights are not enough."""
    requirements = [REQUIRED.format(limit=1e6, probability=probability)]
    judgement, models = judged(tmp_path / "c", requirements, runs=32)
    (verdict,) = [item.controllers["tlc"] for item in models[VERDICTS].requirements]
    least = flights_to_pass(verdict.failures, probability, verdict.consumer_risk)
    assert flights in (least, None)
    assert fixed(least, 0) in judgement.next.why
    assert judgement.next.command.endswith(f"--runs {flights}" if flights else "")
    assert bool(judgement.next.command) == bool(flights)


def test_a_missed_requirement_has_its_share_of_failures(tmp_path):
    """Regression: readers had to divide the failures by the flights."""
    judgement, _ = judged(
        tmp_path / "c", [REQUIRED.format(limit=1e-9, probability=0.9)], controllers=["tlc"]
    )
    share = f"60 of 60 flights, {percent(1.0)}; {percent(0.1)} allowed"
    assert share in judgement.answer


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
