"""Stored flights of a user's simulator that give other values when they are run again."""

import re

import pytest
from own_simulators import write_study

from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.flights.repeatability import Repeatability

PROGRAM = """#!/bin/sh
offset=$(cat "$STUDY_DATA")
awk -v a="$1" -v b="$2" -v c="$offset" 'BEGIN {printf "%.17g\\n", a + b + c}'
"""
CALLER = """
import subprocess

def fly(inputs, settings):
    words = ["./model.sh", repr(inputs["a"]), repr(inputs["b"])]
    return {"total": float(subprocess.run(words, capture_output=True, check=True).stdout)}
"""
LATE_NOISE = """
import itertools

count = itertools.count()

def fly(inputs, settings):
    return {"total": inputs["a"] + inputs["b"] + max(next(count) - 60, 0)}
"""

# The state after a flight with a large `a` changes one or all later flights of the process.
DIRTY = """
is_dirty = False

def fly(inputs, settings):
    global is_dirty
    total = inputs["a"] + inputs["b"] + 20 * is_dirty
    is_dirty = inputs["a"] > 7.2 or is_dirty and LASTING
    return {"total": total}
"""


def run(campaign, runs):
    """Run a study with one worker, or extend it."""
    out = campaign.parent / "out"
    return run_campaign(
        Request(campaign, output=out, runs=runs, workers=1, trust_code=True)
    ).manifest


def test_a_data_file_changed_between_runs_takes_the_verdicts(tmp_path, monkeypatch):
    campaign = write_study(
        tmp_path / "own", CALLER, simulator={"python": "sim.py", "files": ["model.sh"]}
    )
    (tmp_path / "own/model.sh").write_text(PROGRAM)
    (tmp_path / "own/model.sh").chmod(0o755)
    data = tmp_path / "data.txt"
    data.write_text("0\n")
    monkeypatch.setenv("STUDY_DATA", str(data))
    manifest = run(campaign, 40)
    assert manifest.repeatable is Repeatability.EXACT
    data.write_text("0.25\n")
    manifest = run(campaign, 80)
    assert manifest.repeatable is Repeatability.NOISE
    assert {requirement.verdict for requirement in manifest.requirements} == {"ESTIMATE"}
    data.write_text("0\n")
    assert run(campaign, 100).repeatable is Repeatability.NOISE  # other flights stay wrong


def test_a_simulator_that_drifts_after_its_first_flights_gets_estimates(tmp_path):
    manifest = run(write_study(tmp_path / "own", LATE_NOISE), 200)
    assert manifest.repeatable is Repeatability.NOISE
    assert any(re.search(r"'system' .*\btotal\b", warning) for warning in manifest.warnings)


@pytest.mark.parametrize("lasting", [False, True])
def test_false_failures_after_one_percent_of_the_flights_take_the_verdicts(tmp_path, lasting):
    """True failures, which recur, are ten times as frequent as false ones."""
    source = DIRTY.replace("LASTING", str(lasting))
    limit = {"metric": "total", "below": "11.8 m", "probability": "50 %"}
    manifest = run(write_study(tmp_path / "own", source, requirements=[limit]), 400)
    assert manifest.repeatable is Repeatability.NOISE
    assert manifest.requirements[0].verdict == "ESTIMATE"


RECORDED = """
def fly(inputs, settings):
    total = inputs["a"] + inputs["b"]
    open(LOG, "a").write(f"{total!r}\\n")
    if total > 12.5:
        raise ValueError
    return {"total": total}
"""


@pytest.mark.parametrize(("runs", "number"), [(20, 4), (140, 7), (500, 20)])
def test_failures_are_run_again_before_the_worst_flights(tmp_path, runs, number):
    """At most 5 % of the flights and 20; flights that failed to run are not run again."""
    log = tmp_path / "log"
    limit = {"metric": "total", "below": "12.3 m", "probability": "50 %"}
    source = RECORDED.replace("LOG", repr(str(log)))
    study = write_study(tmp_path / "own", source, requirements=[limit])
    assert run(study, runs).repeatable is Repeatability.EXACT
    totals = list(map(float, log.read_text().split()))
    worst = sorted(total for total in totals[-runs - number : -number] if total <= 12.5)
    assert sorted(totals[-number:]) == worst[-number:]
