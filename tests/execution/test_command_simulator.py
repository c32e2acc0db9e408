"""A program that speaks JSON lines: crashes, hangs, kills, shards; all tables are equal."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from own_simulators import dive_campaign

from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.folder.samples import SampleReader
from abhv_mc.folder.tables import export_csv

CRASHES, HANGS = 123, 777  # numbers of the flights

PROGRAM = """
import json, math, os, sys, time

crash, hang = map(float, sys.argv[1:])
for line in sys.stdin:
    given = json.loads(line)
    v, pull = given["inputs"], given["settings"]["pull"]
    low = v["altitude"] - v["speed"] * math.sin(math.radians(v["dive"])) * v["delay"]
    low -= v["speed"] ** 2 / (32.174 * (pull - 1.0) * v["thrust"]) * 0.5
    if pull == 5.0 and v["altitude"] == crash:
        os.abort()
    if pull == 5.0 and v["altitude"] == hang:
        time.sleep(600.0)
    time.sleep(0.002)
    print(json.dumps({"altitude_min": low, "load": pull * v["thrust"]}), flush=True)
"""


@pytest.fixture
def campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "program.py").write_text(PROGRAM)
    command = [sys.executable, "program.py"]
    simulator = {"command": [*command, "nan", "nan"], "files": ["program.py"], "time_limit": "1 s"}
    path = dive_campaign(folder, runs=1000, simulator=simulator)
    run_campaign(Request(path, tmp_path / "well", workers=2))  # draws the samples
    wrong = SampleReader(tmp_path / "well" / "samples.parquet").rows(0, 1000)[:, 0]
    simulator["command"] = [*command, repr(float(wrong[CRASHES])), repr(float(wrong[HANGS]))]
    return dive_campaign(folder, runs=1000, simulator=simulator)


def test_a_crash_and_a_hang_cost_two_flights_and_all_ways_give_equal_tables(campaign: Path, tmp_path: Path) -> None:
    whole = run_campaign(Request(campaign, tmp_path / "whole", workers=2)).manifest
    assert whole.complete
    assert whole.controllers["v1"].failed_to_run == (CRASHES, HANGS)
    assert whole.controllers["v2"].failed_to_run is None
    results, well = read_flown(tmp_path / "whole"), read_flown(tmp_path / "well")
    kept = np.isin(well.flights["v1"].flight, results.flights["v1"].flight)
    for metric in ("altitude_min", "load"):
        values = well.flights["v1"].metrics[metric][kept]
        assert np.array_equal(values, results.flights["v1"].metrics[metric])

    killed = tmp_path / "killed"
    command = [sys.executable, "-m", "abhv_mc", "run", campaign, "-o", killed, "--workers", "2", "--no-report"]
    process = subprocess.Popen(list(map(str, command)), start_new_session=True, stderr=subprocess.DEVNULL)
    while not list(killed.glob("flights/*.parquet")):
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert read_manifest(killed / "manifest.json").state != "complete"
    assert run_campaign(Request(campaign, killed, workers=2)).manifest.digest == whole.digest

    shards = [tmp_path / f"shard{i}" for i in (1, 2, 3)]
    for i, out in enumerate(shards, 1):
        run_campaign(Request(campaign, out, shard=(i, 3), workers=2))
    merged = merge_campaign(shards, tmp_path / "merged").manifest
    assert merged.digest == whole.digest
    assert merged.requirements == whole.requirements
    tables = [next(p for p in export_csv(tmp_path / name, tmp_path / f"csv_{name}") if p.name == "flights.csv")
              for name in ("whole", "killed", "merged")]  # fmt: skip
    assert len({tuple(sorted(table.read_text().splitlines())) for table in tables}) == 1
