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
    judge_campaign,
)
from abhv_mc.report.numbers.judgement_record import read_judgement
from abhv_mc.report.numbers.pass_chances import plan_campaign
from abhv_mc.topics.formatting import percent
from abhv_mc.topics.json_data import json_data
from abhv_mc.topics.topic import Models

REQUIRED = (
    "{{metric: speed_error_max_mps, below: {limit}, probability: {probability}, "
    "consumer_risk: 0.1}}"
)


def judged(folder, requirements, **keys):
    keys = {"controllers": ["tlc", "lqr"], **keys}
    models = Models(read_flown(write_campaign(folder, requirements=requirements, **keys)))
    return judge_campaign(models), models


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
