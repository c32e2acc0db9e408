"""Looks at a verdict are recorded, and a campaign that is extended after one has no exact verdict left."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fake_flight import DENSITY, ENGINE, fly, write_campaign

from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.flight.outcome import Outcome
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.report.numbers.results import read_results

# About 4.5 % of the fake flights fail: proven at 90 %, open at 96 %.
CLOSE = "[{metric: altitude_error_max_m, below: 50, probability: 0.96}]"
PROVEN = "[{metric: altitude_error_max_m, below: 50, probability: 0.9}]"


@pytest.fixture(autouse=True)
def quiet(capfd):
    """Progress goes to standard error."""


def run(campaign, out, engine=ENGINE, **options):
    return run_campaign(Request(campaign, out, **options), engine)


def interrupted_after(blocks):
    count = iter(range(10_000))

    def some(plan, parameters, every=None):
        if next(count) >= blocks + 2:
            raise KeyboardInterrupt
        return fly(plan, parameters, every)

    return replace(ENGINE, fly=some)


def report_verdict(folder, controller="one"):
    return make_numbers(read_results(folder))["requirements"][0]["controllers"][controller]


def test_a_campaign_that_is_extended_after_a_look_has_no_exact_verdict(tmp_path):
    campaign, out = write_campaign(tmp_path / "f", requirements=CLOSE), tmp_path / "out"
    first = run(campaign, out, runs=40).manifest
    assert first["looks"] == [40] and first["requirements"][0]["verdict"] == "NOT SHOWN"
    longer = run(campaign, out, runs=2000).manifest
    assert longer["looks"] == [40, 2000]
    (entry,) = longer["requirements"]
    assert entry["verdict"] == "ESTIMATE" and "no exact verdict is left" in entry["words"]
    assert report_verdict(out)["status"] == "ESTIMATE"


def test_what_the_first_look_settled_stays_with_its_flights(tmp_path):
    campaign, out = write_campaign(tmp_path / "f", requirements=PROVEN), tmp_path / "out"
    assert run(campaign, out).manifest["requirements"][0]["verdict"] == "PASS"
    (entry,) = run(campaign, out, runs=600).manifest["requirements"]
    assert (entry["verdict"], entry["verdict_flights"], entry["flights"]) == ("PASS", 300, 600)
    assert "settled by the first 300 flights" in entry["words"] and "in all 600 flights" in entry["words"]
    verdict = report_verdict(out)
    assert (verdict["status"], verdict["runs"], verdict["words"]) == ("PASS", 300, entry["words"])


def test_interruptions_are_no_looks(tmp_path):
    campaign, out = write_campaign(tmp_path / "f", requirements=CLOSE), tmp_path / "out"
    part = run(campaign, out, interrupted_after(3), workers=1).manifest
    assert part["looks"] == [] and part["requirements"][0]["verdict"] == "ESTIMATE"
    whole = run(campaign, out).manifest
    assert whole["looks"] == [300] and whole["requirements"][0]["verdict"] != "ESTIMATE"
    assert run(campaign, out).manifest["looks"] == [300]


def test_a_family_is_held_over_all_pairs_of_requirement_and_controller(tmp_path):
    # 300 flights, some 4 % fail: PASS at 93 % with a risk of 10 %, not with a hundredth of it.
    asked = "[{metric: altitude_error_max_m, below: 50, probability: 0.93}]"
    alone = run(write_campaign(tmp_path / "f", requirements=asked), tmp_path / "a").manifest
    family = "{method: holm, risk: 0.001}"
    held = run(write_campaign(tmp_path / "g", requirements=asked, family=family), tmp_path / "b").manifest
    assert [m["requirements"][0]["verdict"] for m in (alone, held)] == ["PASS", "NOT SHOWN"]
    assert report_verdict(tmp_path / "b")["status"] == "NOT SHOWN"
    assert make_numbers(read_results(tmp_path / "a"))["any_false_pass"] == pytest.approx(0.2)
    assert make_numbers(read_results(tmp_path / "b"))["any_false_pass"] == pytest.approx(0.001)


# Flights that could not be computed


def failing_to_run(broken, below=1.0555):
    """An engine under which the flights of these densities cannot be computed, while ``broken`` holds true."""

    def some(plan, parameters, every=None):
        block = fly(plan, parameters, every)
        lost = (parameters[:, DENSITY] > 1.05) & (parameters[:, DENSITY] < below) & broken[0]
        metrics, history = block.metrics.copy(), block.history.copy()
        metrics[lost], history[lost] = np.nan, np.nan
        outcome = np.where(lost, Outcome.FAILED_TO_RUN, block.outcome)
        return replace(block, outcome=outcome, metrics=metrics, history=history)

    return replace(ENGINE, fly=some)


def test_uncomputed_flights_count_as_failures_and_the_next_run_tries_them_again(tmp_path):
    campaign, out, broken = write_campaign(tmp_path / "f", requirements=PROVEN), tmp_path / "out", [True]
    whole = run(campaign, tmp_path / "whole").manifest
    flawed = run(campaign, out, failing_to_run(broken)).manifest
    lost = len(flawed["controllers"]["one"]["failed_to_run"])
    (entry,) = flawed["requirements"]
    assert lost >= 3 and flawed["runs_failed"] == lost
    assert entry["flights"] == 300 and entry["failures_not_computed"] == lost
    assert entry["failures"] == whole["requirements"][0]["failures"] + lost
    assert f"{lost} of them flights that the machine could not compute" in entry["words"]
    verdict = report_verdict(out)
    assert (verdict["status"], verdict["words"]) == (entry["verdict"], entry["words"])
    broken[0] = False
    healed = run(campaign, out, failing_to_run(broken)).manifest
    assert healed["runs_failed"] == 0 and healed["looks"] == [300]
    assert healed["digest"] == whole["digest"] and healed["requirements"] == whole["requirements"]
    for name in ("envelopes.parquet", "histories/one-000000.parquet"):
        assert (out / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_sequential_look_settles_nothing_before_its_uncomputed_flights_were_tried_again(tmp_path):
    def make(name):
        return write_campaign(tmp_path / name, requirements=PROVEN, runs="2000", stop="when proven")

    whole = run(make("f"), tmp_path / "whole").manifest
    calls = iter(range(10_000))
    broken = [True]
    flawed = failing_to_run(broken)

    def heals(plan, parameters, every=None):
        next(calls)
        broken[0] = every is not None  # what is tried again is flown without a history
        return flawed.fly(plan, parameters, every)

    healed = run(make("g"), tmp_path / "out", replace(ENGINE, fly=heals)).manifest
    assert healed["runs_failed"] == 0 and healed["stopped_at"] == whole["stopped_at"]
    assert healed["requirements"] == whole["requirements"]


def test_manifest_and_report_agree_on_a_look_that_ends_in_uncomputed_flights(tmp_path):
    campaign = write_campaign(tmp_path / "f", requirements=PROVEN, runs="2000", stop="when proven")
    manifest = run(campaign, tmp_path / "out", failing_to_run([True], 1.08)).manifest
    (entry,) = manifest["requirements"]
    verdict = report_verdict(tmp_path / "out")
    assert manifest["runs_failed"] > 0
    assert (verdict["status"], verdict["runs"]) == (entry["verdict"], entry["verdict_flights"])
    assert verdict["words"] == entry["words"]
    assert json.loads((tmp_path / "out/manifest.json").read_text())["looks"][-1] == manifest["stopped_at"]
