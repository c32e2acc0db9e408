"""Flights that raise, hang or end their process; workers that are killed."""

import contextlib
import ctypes
import functools
import multiprocessing
import os
import random
import signal
import threading
from dataclasses import replace

import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest
from fake_flight import DENSITY, ENGINE, fly, fly_slowly, run, write_campaign

from abhv_mc.campaign.file.config import PROCESSES
from abhv_mc.execution.retry import UnusableError

KEEP = "{histories: {flights: [worst 5, every 10], rate: 10 Hz}, envelopes: {rate: 5 Hz}}"


def is_bad(density):
    """Return whether a flight has the fault: about three of 300 have it."""
    return np.abs(density - 1.0) < 1e-3


def _plant(fault, plan, parameters, every):
    if (
        is_bad(parameters[:, DENSITY]) & (parameters[:, DENSITY] != 1.0)
    ).any():  # the nominal flight has density 1
        fault()
    return fly(plan, parameters, every)


def fly_raising(plan, parameters, every=None):
    return _plant(lambda: 1 // 0, plan, parameters, every)


def fly_hanging(plan, parameters, every=None):
    return _plant(_compute_for_ever, plan, parameters, every)


def _compute_for_ever():
    while True:
        pass


def fly_segfaulting(plan, parameters, every=None):
    return _plant(lambda: ctypes.string_at(0), plan, parameters, every)


def fly_exiting(plan, parameters, every=None):
    return _plant(lambda: os._exit(3), plan, parameters, every)


def fly_nowhere(plan, parameters, every=None):
    if multiprocessing.parent_process() is not None and (parameters[:, DENSITY] != 1.0).any():
        os._exit(3)
    return fly(plan, parameters, every)


def fly_after_killed_starts(folder, plan, parameters, every=None):
    """Fly after ten processes were killed at their start, as on a machine short of memory."""
    started = folder / f"{os.getpid()}"
    if multiprocessing.parent_process() is not None and not started.exists():
        started.touch()
        if len(list(folder.iterdir())) <= 10:
            os.kill(os.getpid(), signal.SIGKILL)
    return fly(plan, parameters, every)


def engine_of(function):
    return replace(ENGINE, fly=function, isolation=PROCESSES)


@pytest.mark.parametrize(
    ("function", "isolation", "reason"),
    [
        (fly_raising, "threads", "ZeroDivisionError"),
        (fly_raising, "processes", "ZeroDivisionError"),
        (fly_segfaulting, "processes", "SIGSEGV"),
        (fly_exiting, "processes", "exit code 3"),
        (fly_hanging, "processes", " 0.3 s"),
    ],
)
def test_a_bad_flight_fails_to_run(tmp_path, function, isolation, reason, capfd):
    # Blocks of 150 flights have ten limits of processor time: a hanging flight is detected after
    # 3 s, and then twice after 0.3 s.
    execution = f"{{workers: 2, batch: 150, isolation: {isolation}, flight_time_limit: 0.3 s}}"
    campaign = write_campaign(
        tmp_path / "f", execution=execution, keep=KEEP, controllers="{one: one.yaml}"
    )
    reference = run(campaign, tmp_path / "a")
    flawed = run(campaign, tmp_path / "b", engine_of(function))
    rows = [pq.read_table(tmp_path / out / "flights").sort_by("flight") for out in ("a", "b")]
    bad = is_bad(rows[0]["atmosphere.density"].to_numpy())
    assert 1 <= bad.sum() <= 5
    assert flawed.complete and reason in capfd.readouterr().err
    assert np.array_equal(np.array(rows[1]["outcome"].to_pylist()) == "failed_to_run", bad)
    assert rows[1].filter(~bad).equals(rows[0].filter(~bad))
    manifest = flawed.manifest
    assert manifest.runs_failed == bad.sum() and manifest.runs_done == 300 - bad.sum()
    assert manifest.controllers["one"].failed_to_run == tuple(np.flatnonzero(bad))
    assert manifest.digest != reference.manifest.digest
    counts = pq.read_table(tmp_path / "b/envelopes.parquet")["count"].to_pylist()
    assert max(counts) == 300 - bad.sum()
    again = run(campaign, tmp_path / "b", engine_of(function)).manifest
    assert again.controllers == manifest.controllers and again.digest == manifest.digest


def test_a_machine_that_computes_no_flight_stops_the_campaign(tmp_path, capfd):
    campaign = write_campaign(tmp_path / "f", runs="32", execution="{workers: 2, batch: 16}")
    with pytest.raises(UnusableError, match="exit code 3"):
        run(campaign, tmp_path / "out", engine_of(fly_nowhere))
    assert not list((tmp_path / "out/flights").glob("*.parquet"))
    assert run(campaign, tmp_path / "out").complete


def test_killed_starts_are_repeated_and_lose_no_flight(tmp_path, capfd):
    campaign = write_campaign(tmp_path / "f", execution="{workers: 2, batch: 100}")
    reference = run(campaign, tmp_path / "a").manifest
    (tmp_path / "started").mkdir()
    fly_late = functools.partial(fly_after_killed_starts, tmp_path / "started")
    flown = run(campaign, tmp_path / "b", engine_of(fly_late)).manifest
    assert len(list((tmp_path / "started").iterdir())) > 10
    assert flown.digest == reference.digest and flown.runs_failed == 0


def test_killed_workers_lose_no_flight(tmp_path, capfd):
    campaign = write_campaign(tmp_path / "f", execution="{workers: 2, batch: 4}")
    reference = run(campaign, tmp_path / "a").manifest
    moments, kills, ended = random.Random(4), [], threading.Event()

    def kill_workers():
        while not ended.wait(moments.uniform(0.1, 0.4)):
            with contextlib.suppress(psutil.NoSuchProcess):  # ended while it was looked for
                workers = [
                    c for p in psutil.Process().children() for c in p.children()
                ]  # children of the fork server
                if workers and len(kills) < 10:
                    kills.append(moments.choice(workers))
                    kills[-1].kill()

    killer = threading.Thread(target=kill_workers)
    killer.start()
    try:
        flown = run(campaign, tmp_path / "b", engine_of(fly_slowly)).manifest
    finally:
        ended.set()
        killer.join()
    assert len(kills) >= 5
    assert flown.digest == reference.digest and flown.runs_failed == 0
    for name in ("envelopes.parquet", "histories/one-000000.parquet"):
        assert pq.read_table(tmp_path / "a" / name).equals(pq.read_table(tmp_path / "b" / name))
