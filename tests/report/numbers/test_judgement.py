"""The judgement on a campaign: both answers, what they rest on and what would help."""

from dataclasses import replace

import pytest
from report.few_figures import build_with
from report.synthetic import write_campaign

from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.report.numbers.judged import read_judgement
from abhv_mc.report.numbers.judgement import ALONE, NO_DIFFERENCE, flights_jointly, judge_campaign
from abhv_mc.statistics.family import hold_family
from abhv_mc.statistics.verdicts import judge
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS

REQUIRED = "{{metric: speed_error_max_mps, below: {limit}, probability: {probability}, consumer_risk: 0.1}}"


def judged(folder, requirements, **keys):
    keys = {"controllers": ["tlc", "lqr"], **keys}
    models = Models(read_flown(write_campaign(folder, requirements=requirements, **keys)))
    return judge_campaign(models), models


@pytest.mark.parametrize(
    ("limit", "probability", "met", "command"),
    [
        (1e6, 0.5, "yes", ""),
        (1e6, 0.99, "not shown", "--runs"),
        (1e6, 0.999999, "not shown", ""),  # would take more than ten times the flights
        (1e-9, 0.9, "no", "explain DIR --all"),
    ],
)
def test_what_is_met_and_what_would_help(tmp_path, limit, probability, met, command):
    found, _ = judged(tmp_path / "c", [REQUIRED.format(limit=limit, probability=probability)])
    assert found.met == met
    assert command in found.next.command
    assert (found.next.command == "") == (command == "")


def test_the_stored_judgement_is_the_same(tmp_path):
    folder = tmp_path / "c"
    found, _ = judged(folder, [REQUIRED.format(limit=1e6, probability=0.99)])
    build_with(folder)
    manifest = read_flown(folder).manifest
    assert read_judgement(folder, manifest) == found
    assert read_judgement(folder, replace(manifest, digest="another")) is read_judgement(tmp_path, manifest) is None


def test_flights_jointly_would_let_every_pass_stand(tmp_path):
    _, models = judged(tmp_path / "c", [REQUIRED.format(limit=1e6, probability=0.95)], runs=60)
    verdicts = models[VERDICTS]
    assert verdicts.held_together.dropped
    flights = flights_jointly(verdicts)
    for runs, stand in ((flights, True), (flights - 1, False)):
        held = hold_family([judge(0, runs, 0.95)] * verdicts.held_together.verdicts, verdicts.held_together.risk)
        assert all(each.status == "PASS" for each in held) is stand


def test_lost_flights_lead_what_is_better(tmp_path):
    requirements = [REQUIRED.format(limit=1e6, probability=0.5)]
    found, _ = judged(tmp_path / "c", requirements, failing=20)
    assert found.better == "tlc" and found.because[0].startswith("Lost flights: ") and len(found.because) <= 3
    assert judged(tmp_path / "one", requirements, controllers=["tlc"])[0].better == ALONE
    assert judged(tmp_path / "lhs", requirements, sampling="lhs", runs=16)[0].better == NO_DIFFERENCE
