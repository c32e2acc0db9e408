"""Flights on a Dask cluster, started as its documentation describes, have the same digest."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import DENSITY, ENGINE, fly, fly_slowly, make_plan, run, write_campaign
from own_simulators import DIVE_CHANNELS, DIVE_HISTORY, dive_campaign

from abhv_mc.campaign.file.config import Execution
from abhv_mc.cli.errors import ExitCode, exit_code_of
from abhv_mc.execution.executor import open_executor
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.retry import UnusableError
from abhv_mc.execution.runner import run_campaign
from abhv_mc.io.messages import InputError
from abhv_mc.requests import Request
from abhv_mc.shipped import shipped_campaigns
from abhv_mc_remote.cluster import connect_cluster
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.vehicle_simulator.simulator import make_engine

pytest.importorskip("distributed")


def fly_hanging(plan, parameters, every=None):
    density = parameters[:, DENSITY]
    if ((density > 1.0) & (density < 1.01)).any():
        time.sleep(3600.0)
    return fly(plan, parameters, every)


def fly_when_let(plan, parameters, every=None):
    while Path(os.environ["HELD"]).exists():
        time.sleep(0.02)
    return fly(plan, parameters, every)


class Dask:
    """Cluster on this machine."""

    def __init__(self, folder):
        self._file, self.processes = folder / "scheduler.json", []
        # One dead worker, instead of four, already splits a block; this makes the tests faster.
        self.held = folder / "held"
        failures = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
        self._environment = os.environ | failures | {"HELD": str(self.held)}
        self.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        # The file may exist before it has content, so wait for the address.
        while not (self._file.exists() and self._file.read_text().endswith("}")):
            time.sleep(0.05)

    def start(self, *arguments):
        command = [sys.executable, "-m", "dask", *arguments, "--scheduler-file", str(self._file)]
        quiet = {
            "stdout": subprocess.DEVNULL,
            "stderr": subprocess.DEVNULL,
            "start_new_session": True,
        }
        self.processes.append(subprocess.Popen(command, env=self._environment, **quiet))
        return self.processes[-1]

    def start_worker(self):
        return self.start("worker", "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard")

    @property
    def address(self):
        return json.loads(self._file.read_text())["address"]

    def kill(self, process):
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def close(self):
        for process in self.processes:
            if process.poll() is None:
                self.kill(process)


@pytest.fixture
def dask(tmp_path):
    cluster = Dask(tmp_path)
    yield cluster
    cluster.close()


def wait_for_flights(out, number):
    while sum(1 for _ in (out / "flights").glob("*.parquet")) < number:
        time.sleep(0.02)


REAL = shipped_campaigns() / "s_manoeuvre.yaml"
RUNS = 192


@pytest.fixture(scope="module")
def local_folder(tmp_path_factory):
    """Return the folder of compiled flights by two local worker processes."""
    request = Request(
        REAL, tmp_path_factory.mktemp("local") / "out", RUNS, controllers=("tlc",), workers=2
    )
    return run_campaign(request, make_engine()).folder


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory):
    cluster = Dask(tmp_path_factory.mktemp("dask"))
    cluster.start_worker()
    cluster.start_worker()
    yield cluster
    cluster.close()


def test_a_cluster_shards_and_one_worker_give_the_same_bits(local_folder, two_workers, tmp_path):
    """Compare digest, envelopes and histories of compiled flights."""
    request = Request(
        REAL, tmp_path / "dask", RUNS, controllers=("tlc",), scheduler=two_workers.address
    )
    folders = [run_campaign(request, make_engine()).folder]
    folders.append(
        run_campaign(
            replace(request, output=tmp_path / "one", scheduler=None, workers=1), make_engine()
        ).folder
    )
    parts = [tmp_path / "part1", tmp_path / "part2"]
    for i, shard in enumerate(parts, 1):
        run_campaign(replace(request, output=shard, scheduler=None, shard=(i, 2)), make_engine())
    folders.append(merge_campaign(parts, tmp_path / "merged").folder)
    digests = {
        json.loads((folder / "manifest.json").read_text())["digest"]
        for folder in (local_folder, *folders)
    }
    assert len(digests) == 1
    for name in ("envelopes.parquet", "histories/tlc-000000.parquet"):
        expected = pq.read_table(local_folder / name).to_pandas()  # pandas compares NaN as equal
        assert len(expected) and all(
            pq.read_table(folder / name).to_pandas().equals(expected) for folder in folders
        ), name


def test_a_plan_lost_with_its_worker_is_sent_again(dask):
    """A plan that Dask lost with a worker is sent again; its flights must not fail to run."""
    dask.held.touch()
    worker, rows = dask.start_worker(), np.repeat(nominal_parameters(), 8, axis=0)
    flown = {}
    engine = replace(ENGINE, fly=fly_when_let)
    with (
        connect_cluster(dask.address) as opened,
        contextlib.closing(opened(engine, 60.0)) as cluster,
        open_executor(engine, Execution(), None, lambda *_: cluster) as runner,
    ):

        def start(name):
            work = threading.Thread(
                target=lambda: flown.update({name: runner.fly(make_plan(name), rows)})
            )
            work.start()
            return work

        busy = start("one")  # occupies the only thread
        while not any(cluster._client.processing().values()):
            time.sleep(0.02)
        waiting = start("two")  # its plan is on the same worker, which has not begun it
        while sum(len(tasks) for tasks in cluster._client.processing().values()) < 2:
            time.sleep(0.02)
        dask.kill(worker)
        dask.held.unlink()
        dask.start_worker()
        busy.join()
        waiting.join()
    expected = fly(make_plan("two"), rows)
    for block in flown.values():
        assert np.array_equal(block.outcome, expected.outcome) and np.array_equal(
            block.metrics, expected.metrics
        )


def test_a_lost_scheduler_ends_the_run_and_the_same_command_resumes(dask, tmp_path):
    dask.start_worker()
    campaign, out = write_campaign(tmp_path / "f", execution="{batch: 8}"), tmp_path / "out"

    def kill_it():
        wait_for_flights(out, 5)
        for process in dask.processes:
            dask.kill(process)

    killer = threading.Thread(target=kill_it, daemon=True)
    killer.start()
    with pytest.raises(BaseException) as ended:  # noqa: PT011  # of many kinds
        run(campaign, out, replace(ENGINE, fly=fly_slowly), scheduler=dask.address)
    killer.join()
    assert (
        isinstance(ended.value, UnusableError) or exit_code_of(ended.value) == ExitCode.INCOMPLETE
    )
    blocks = sum(1 for _ in (out / "flights").glob("*.parquet"))
    assert (
        5 <= blocks < 76
        and json.loads((out / "manifest.json").read_text())["state"] == "interrupted"
    )
    reference = run(campaign, tmp_path / "whole").manifest
    assert run(campaign, out).manifest.digest == reference.digest


def test_a_hanging_flight_fails_to_run_on_a_cluster(dask, tmp_path):
    dask.start_worker()
    execution = "{batch: 16, flight_time_limit: 0.5 s}"
    campaign = write_campaign(
        tmp_path / "f", execution=execution, runs="16", controllers="{one: one.yaml}"
    )
    request = Request(campaign, tmp_path / "out", workers=1, scheduler=dask.address)
    manifest = run_campaign(request, replace(ENGINE, fly=fly_hanging)).manifest
    density = pq.read_table(tmp_path / "out/samples.parquet")["atmosphere.density"].to_numpy()
    assert manifest.controllers["one"].failed_to_run == tuple(
        np.flatnonzero((density > 1.0) & (density < 1.01))
    )
    assert (manifest.runs_done, manifest.runs_failed) == (15, 1)


def test_workers_with_other_code_stop_the_campaign(dask, tmp_path):
    dask.start_worker()
    request = Request(write_campaign(tmp_path / "f"), tmp_path / "out", scheduler=dask.address)
    with pytest.raises(UnusableError, match=r"\bversion\b"):
        run_campaign(request, replace(ENGINE, checked=True))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "carrier-pigeon://here:1"])
def test_a_missing_scheduler_is_bad_input(tmp_path, monkeypatch, address):
    monkeypatch.setattr("abhv_mc_remote.cluster._CONNECT", 0.5)
    request = Request(write_campaign(tmp_path / "f"), tmp_path / "out", scheduler=address)
    with pytest.raises(InputError, match=re.escape(address)):
        run_campaign(request, ENGINE)
    assert not (tmp_path / "out").exists()


def test_a_user_simulator_runs_on_a_cluster(two_workers, tmp_path, own_list):
    keep = {"histories": {"flights": "every 50"}}
    changes = {"runs": 300, "execution": {"batch": 40}, "histories": DIVE_CHANNELS, "keep": keep}
    path = dive_campaign(tmp_path / "own", DIVE_HISTORY, **changes)
    local = run_campaign(Request(path, tmp_path / "local", workers=2)).manifest
    far = run_campaign(Request(path, tmp_path / "far", scheduler=two_workers.address)).manifest
    assert far.complete and far.digest == local.digest
    for name in ("v1", "v2"):
        local_rows, remote_rows = (
            pq.read_table(next((tmp_path / folder / "histories").glob(f"{name}-*.parquet")))
            for folder in ("local", "far")
        )
        assert len(local_rows) and local_rows.equals(remote_rows)
