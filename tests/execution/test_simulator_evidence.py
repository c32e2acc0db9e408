"""Evidence from user simulators: re-runs from a folder, reasons of failures, and noise."""

import os
import re
from pathlib import Path

import pytest
from own_simulators import shown_text, write_study
from programs import invoke

from abhv_mc.analysis.explain import explain_flight
from abhv_mc.analysis.replay import replay_flight
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.external_simulators.process import end_processes
from abhv_mc.flights.repeatability import Repeatability
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.tables import run_query
from abhv_mc.io.messages import InputError
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.results import Results

pytestmark = pytest.mark.usefixtures("no_figures", "own_list")


PROGRAM = """#!/bin/sh
awk -v a="$1" -v b="$2" 'BEGIN {printf "%.17g\\n", a + b}'
"""
CALLER = """
import subprocess

def fly(inputs, settings):
    words = ["./model.sh", repr(inputs["a"]), repr(inputs["b"])]
    total = float(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
    return {"total": total, "history": {"time": [0.0, 1.0], "x": [0.0, total]}}
"""
WITH_HISTORIES = {
    "histories": {"x": {"unit": "m"}},
    "keep": {"histories": {"flights": "worst 3", "rate": "1 Hz"}},
    "simulator": {"python": "sim.py", "files": ["model.sh"]},
}


def test_a_declared_program_runs_from_the_results_folder_and_its_failure_is_reported(tmp_path):
    path = write_study(tmp_path / "own", CALLER, **WITH_HISTORIES)
    (tmp_path / "own" / "model.sh").write_text(PROGRAM)
    (tmp_path / "own" / "model.sh").chmod(0o755)
    shards = [tmp_path / "a", tmp_path / "b"]
    for number, shard in enumerate(shards, 1):
        run_campaign(Request(path, shard, shard=(number, 2)))
    end_processes()
    merged = merge_campaign(shards, tmp_path / "merged")
    assert merged.manifest.not_made == ()
    assert Results(merged.folder).histories["flight"].nunique() == 3
    totals = read_flown(merged.folder).flights["system"].metrics["total"]
    assert replay_flight(merged.folder, "system", 0).differences == ()
    worst = int(totals.argmax())
    assert explain_flight(merged.folder, "system", worst).causes
    copies = merged.folder / "inputs" / "simulator"
    assert os.access(copies / "model.sh", os.X_OK) and not os.access(copies / "sim.py", os.X_OK)
    end_processes()
    # The copies of the program cannot start, as on another machine: histories are lost.
    for shard in shards:
        (shard / "inputs" / "simulator" / "model.sh").chmod(0o644)
    out = tmp_path / "without"
    answer = invoke("merge", *shards, "-o", out, "--no-report")
    assert answer.exit_code == 3
    (reason,) = {
        sentence.partition(" (")[2]
        for sentence in Results(out).manifest.not_made
        if " (" in sentence
    }
    assert "PermissionError" in reason
    with pytest.raises(InputError, match="PermissionError"):
        explain_flight(out, "system", worst)
    (difference,) = [
        sentence
        for sentence in replay_flight(out, "system", worst).differences
        if sentence.startswith("outcome")
    ]
    assert "PermissionError" in difference


FAILING = """
import os

def fly(inputs, settings):
    if inputs["a"] > 6.0:
        raise ValueError("the table ends at 6\\n\\ud800")
    if inputs["b"] > 6.0:
        os.abort()
    return {"total": inputs["a"] + inputs["b"]}
"""


def test_reasons_are_stored_with_flights_and_reported_and_enter_no_digest(tmp_path):
    path = write_study(tmp_path / "own", FAILING, runs=60)
    result = run_campaign(Request(path, tmp_path / "out"))
    sql = "select outcome, a, b, reason from flights order by flight"
    rows = run_query(tmp_path / "out", sql, lambda table: table.fetchall())
    assert rows
    for outcome, a, b, reason in rows:
        if a > 6.0:
            assert re.fullmatch(r"ValueError: .* 6 \? \(sim\.py, .*\b6\)", reason)
        elif b > 6.0:
            assert "SIGABRT" in reason
        else:
            assert (outcome, reason) == ("ok", "")
    assert {row[0] for row in rows} == {"ok", "failed_to_run"}
    flights = read_flown(tmp_path / "out").flights["system"]
    assert sorted(flights.reasons) == flights.absent.tolist()
    facts = Results(tmp_path / "out").simulator
    assert (facts.repeatable, facts.files) == ("yes", ("sim.py",))
    counts = {reason.reason: reason.flights for reason in facts.reasons["system"]}
    assert facts.events["system"]["restarts"] == sum(
        flights for reason, flights in counts.items() if "SIGABRT" in reason
    )
    assert sum(counts.values()) == flights.absent.size > 0
    text = shown_text(build_report(tmp_path / "out"))
    assert all(reason in text for reason in counts)
    changed = FAILING.replace("ends", "stops")
    path = write_study(tmp_path / "own", changed, runs=60)
    other = run_campaign(Request(path, tmp_path / "other"))
    assert other.manifest.digest == result.manifest.digest


SEEDED = """
import numpy as np
generator = np.random.default_rng({seed})

def fly(inputs, settings):
    total = inputs["a"] + inputs["b"]
    return {{"total": total {noise}, "history": {{"time": [0.0, 1.0], "x": [0.0, total]}}}}
"""
NOISE = "+ 0.1 * generator.normal()"
ROUNDED = "* (1.0 + 1e-15 * generator.integers(-2, 3))"
CHANNELS = {"histories": {"x": {"unit": "m"}}, "keep": {"histories": {"flights": "none"}}}


@pytest.mark.parametrize(
    ("seed", "noise", "is_declared", "expected"),
    [
        ("7", NOISE, False, "no"),
        ("", NOISE, False, "no"),
        ("", NOISE, True, "no, independent noise"),
        ("7", NOISE, True, "no, noise that processes share"),
        ("", ROUNDED, False, "rounding"),
        ("7", "", False, "yes"),
    ],
)
def test_noise_is_detected_and_its_statement_is_checked(
    tmp_path, seed, noise, is_declared, expected
):
    source = SEEDED.format(seed=seed, noise=noise)
    simulator = {"python": "sim.py"} | ({"repeatable": "no"} if is_declared else {})
    path = write_study(tmp_path / "own", source, runs=60, simulator=simulator, **CHANNELS)
    manifest = run_campaign(Request(path, tmp_path / "out")).manifest
    assert manifest.repeatable == expected
    is_estimate = not Repeatability(expected).is_evidence
    assert [entry.verdict == "ESTIMATE" for entry in manifest.requirements] == [is_estimate]
    text = shown_text(build_report(tmp_path / "out"))
    begins = {kind: re.split("[.`]", kind.sentence)[0] for kind in Repeatability}
    assert [kind for kind, words in begins.items() if words in text] == [expected]
    status = invoke("runs", tmp_path / "out").output
    assert re.search(rf"repeatable +{expected}: ", status)
    summary = " ".join(record.line for record in Results(tmp_path / "out").summary.records)
    assert ("no verdicts" in summary and "not repeatable" in summary) == is_estimate
    assert list(verify_campaign(tmp_path / "out")) == []
    grown = run_campaign(Request(path, tmp_path / "out", runs=80)).manifest
    assert grown.repeatable == expected
    assert (grown.requirements[0].verdict == "ESTIMATE") == is_estimate
    replayed = invoke("replay", tmp_path / "out", "--flight", 3)
    assert replayed.exit_code == (1 if is_estimate else 0), replayed.output


def test_the_least_repeatable_shard_decides(tmp_path):
    """First flights of one shard show noise, because a file outside its folder exists."""
    switch = tmp_path / "switch"
    noise = f"+ __import__('os').path.exists({str(switch)!r}) * generator.normal()"
    path = write_study(tmp_path / "own", SEEDED.format(seed="", noise=noise), **CHANNELS)
    shards = [tmp_path / "a", tmp_path / "b"]
    run_campaign(Request(path, shards[0], shard=(1, 2)))
    switch.touch()
    run_campaign(Request(path, shards[1], shard=(2, 2)))
    merged = merge_campaign(shards, tmp_path / "merged").manifest
    assert merged.repeatable == "no"
    assert [entry.verdict for entry in merged.requirements] == ["ESTIMATE"]


def test_a_flight_that_fails_in_one_process_is_not_repeatable(tmp_path):
    source = f"""
import os

def fly(inputs, settings):
    os.mkdir({str(tmp_path / "once")!r}) if inputs["a"] > 4.0 else None
    return {{"total": 1.0}}
"""
    manifest = run_campaign(
        Request(write_study(tmp_path / "own", source), tmp_path / "out")
    ).manifest
    assert manifest.repeatable == "no"
    assert any("outcome" in warning for warning in manifest.warnings)


def test_a_check_flight_that_was_killed_once_is_repeated(tmp_path):
    source = f"""
import os
flights = 0

def fly(inputs, settings):
    global flights
    flights += 1
    if flights == 3 and not os.path.exists({str(tmp_path / "once")!r}):
        open({str(tmp_path / "once")!r}, "x")
        os.kill(os.getpid(), 9)
    return {{"total": 1.0}}
"""
    path = write_study(tmp_path / "own", source, runs=40)
    manifest = run_campaign(Request(path, tmp_path / "out")).manifest
    assert manifest.repeatable == "yes" and manifest.requirements[0].verdict == "PASS"


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="needs Linux's /proc")
def test_undeclared_open_files_are_reported(tmp_path, monkeypatch):
    # The files of the test are hardly older than its run, which starts after some 13 ms.
    monkeypatch.setattr("abhv_mc.custom_code.read_guard._CLOCK_STEP", 0.0)
    program = """#!/bin/sh
exec 5<"{model}" 6<./gains.txt
while read -r line; do echo '{{"total": 1}}'; done
"""
    path = write_study(
        tmp_path / "own", "", simulator={"command": ["./model.sh"], "files": ["gains.txt"]}
    )
    for name in ("gains.txt", "model.txt"):
        (tmp_path / "own" / name).write_text("2")
    script = tmp_path / "own" / "model.sh"
    script.write_text(program.format(model=tmp_path / "own" / "model.txt"))
    script.chmod(0o755)
    manifest = run_campaign(Request(path, tmp_path / "out")).manifest
    assert len([warning for warning in manifest.warnings if "own/model.txt" in warning]) == 1
