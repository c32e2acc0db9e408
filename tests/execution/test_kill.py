"""SIGKILL to any process at any moment: the same command completes with the same digest."""

import contextlib
import multiprocessing
import os
import random
import resource
import signal
import sys
import time
from dataclasses import replace

import psutil
import pyarrow.parquet as pq
import pytest
from fake_flight import SLOW_ENGINE, run, write_campaign

from abhv_mc.campaign.file.config import PROCESSES, THREADS
from abhv_mc.folder import envelope_states as collector
from abhv_mc.folder.layout import StorageFullError

ROUNDS = 10  # kills of one test: 60 in all
OTHERS = 0.75  # share of the kills of other processes than the parent
SERVER = multiprocessing.get_context("forkserver")


def fly_in_child(campaign, out, number, isolation=THREADS):
    os.setsid()  # identifies its workers
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a background job
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    collector.ENVELOPE_FLIGHTS = number
    run(campaign, out, replace(SLOW_ENGINE, isolation=isolation), workers=2)


def count_blocks(out):
    return len(list((out / "flights").glob("*.parquet")))


def wait_for_nobody(session):
    """Wait until all workers have ended after their parent; fail if one does not."""
    deadline = time.monotonic() + 60.0
    while left := [process for process in psutil.process_iter() if in_session(process, session)]:
        assert time.monotonic() < deadline, left
        time.sleep(0.02)


def in_session(process, session):
    try:
        return os.getsid(process.pid) == session and process.status() != psutil.STATUS_ZOMBIE
    except (ProcessLookupError, psutil.Error):
        return False


def describe(process, parent):
    if process == parent:
        return "parent"
    if psutil.Process(process).ppid() != parent:
        return "worker"
    return (
        "tracker" if "resource_tracker" in " ".join(psutil.Process(process).cmdline()) else "server"
    )


class Campaign:
    """Campaign that is killed and restarted until it completes, in one folder after another."""

    def __init__(self, folder, number, isolation, seed):
        self.file = write_campaign(folder / "files", execution="{batch: 16}")
        self.folder, self.number, self.isolation = folder, number, isolation
        self.moments, self.kills = random.Random(seed), []

    def live(self, out):
        """Start the run and kill random processes; return its exit code, None if it was killed."""
        child = SERVER.Process(
            target=fly_in_child, args=(self.file, out, self.number, self.isolation)
        )
        child.start()
        if (
            self.isolation == PROCESSES and self.moments.random() < 0.8
        ):  # wait for a first block, as processes take time to start
            blocks = count_blocks(out)
            while child.exitcode is None and count_blocks(out) == blocks:
                child.join(0.02)
        while len(self.kills) < ROUNDS:
            child.join(self.moments.uniform(0.0, 0.4))
            pids = [process for process in psutil.process_iter() if in_session(process, child.pid)]
            pids = sorted({process.pid for process in pids} - {child.pid})
            if child.exitcode is not None:
                return child.exitcode
            victim = (
                self.moments.choice(pids) if pids and self.moments.random() < OTHERS else child.pid
            )
            with contextlib.suppress(ProcessLookupError, psutil.NoSuchProcess):
                kind = describe(victim, child.pid)
                os.kill(victim, signal.SIGKILL)
                self.kills.append(kind)
            if victim == child.pid:
                child.join()
                wait_for_nobody(child.pid)
                return None
        child.join()
        return child.exitcode


@pytest.mark.parametrize("seed", range(6))
def test_random_kills_lose_no_flight(tmp_path, seed, monkeypatch, capfd):
    """With threads the parent is killed, with processes also workers, fork server and helper."""
    number, isolation = (100, 4096)[seed % 2], THREADS if seed < 2 else PROCESSES
    monkeypatch.setattr(collector, "ENVELOPE_FLIGHTS", number)
    campaign = Campaign(tmp_path, number, isolation, seed)
    reference = run(campaign.file, tmp_path / "whole").manifest
    folders = 0
    while len(campaign.kills) < ROUNDS:
        out, folders = tmp_path / f"out{folders}", folders + 1
        while (code := campaign.live(out)) is None:
            pass
        label = f"seed {seed}, kills: {campaign.kills}"
        assert code == 0, label
        done = run(campaign.file, out)  # reads and checks every block of the complete folder
        assert done.complete and done.manifest.runs_failed == 0, label
        assert done.manifest.digest == reference.digest, label
        for name in ("samples.parquet", "envelopes.parquet", "histories/one-000000.parquet"):
            assert pq.read_table(out / name).equals(pq.read_table(tmp_path / "whole" / name)), label
        assert not list(out.rglob("*.temporary")), label
    print(f"seed {seed}, {folders} folders, kills: {campaign.kills}")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_a_manifest_and_the_run_resumes(tmp_path, number, capfd):
    campaign = write_campaign(tmp_path / "files", execution="{batch: 16}")
    child = SERVER.Process(target=fly_in_child, args=(campaign, tmp_path / "out", 4096))
    child.start()
    while child.is_alive() and not list((tmp_path / "out/flights").glob("*.parquet")):
        time.sleep(0.01)
    os.kill(child.pid, number)
    child.join(60.0)
    child.kill()
    assert child.exitcode == 0
    result = run(campaign, tmp_path / "out", runs=None)
    assert result.complete


def test_simultaneous_runs_in_one_new_folder(tmp_path, capfd):
    """One process runs; the others are rejected or resume its folder. No flight is lost."""
    campaign = write_campaign(tmp_path / "files", execution="{batch: 64}")
    reference = run(campaign, tmp_path / "whole").manifest
    for k in range(4):
        out = tmp_path / f"out{k}"
        children = [
            SERVER.Process(target=fly_in_child, args=(campaign, out, 4096)) for _ in range(3)
        ]
        for child in children:
            child.start()
        for child in children:
            child.join()
        assert 0 in [child.exitcode for child in children]
        done = run(campaign, out)
        assert done.complete and done.manifest.digest == reference.digest
        assert sorted(done.manifest.files) == sorted(reference.files)


def fly_within(campaign, out, size):
    """Run with a limit of file size, which acts like a full disk; exit with code 3 if reached."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    try:
        fly_in_child(campaign, out, 4096)
    except StorageFullError:
        sys.exit(3)


def test_a_full_disk_loses_no_flight_at_any_file(tmp_path, capfd):
    """Each file in turn, from plans to histories, is the first that does not fit on the disk."""
    campaign = write_campaign(tmp_path / "files", execution="{batch: 100}")
    reference = run(campaign, tmp_path / "whole").manifest
    sizes = {path.stat().st_size for path in (tmp_path / "whole").rglob("*") if path.is_file()}
    codes = []
    for size in sorted(sizes):
        child = SERVER.Process(target=fly_within, args=(campaign, tmp_path / "out", size))
        child.start()
        child.join()
        codes.append(child.exitcode)
        assert not list((tmp_path / "out").rglob("*.temporary"))
    assert codes.count(3) > 5 and set(codes) <= {0, 3}
    done = run(campaign, tmp_path / "out")
    assert done.complete and done.manifest.digest == reference.digest
