"""Stored flights of a user's simulator that give other values when they are run again."""

import re
from pathlib import Path

import pytest
from own_simulators import write_study

from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.flight.repeatability import Repeatability
from abhv_mc.folder.manifest import Manifest

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


def run(campaign: Path, runs: int) -> Manifest:
    """Run a study with one worker, or extend it."""
    out = campaign.parent / "out"
    return run_campaign(
        Request(campaign, output=out, runs=runs, workers=1, trust_code=True)
    ).manifest


def test_a_data_file_changed_between_runs_takes_the_verdicts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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


def test_a_simulator_that_drifts_after_its_first_flights_gets_estimates(tmp_path: Path) -> None:
    manifest = run(write_study(tmp_path / "own", LATE_NOISE), 200)
    assert manifest.repeatable is Repeatability.NOISE
    assert any(re.search(r"'system' .*\btotal\b", warning) for warning in manifest.warnings)
