"""Worker processes that stop or lose their fork server are replaced."""

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
from dataclasses import replace
from multiprocessing import forkserver
from pathlib import Path

import numpy as np
import psutil
import pytest
from fake_flight import DENSITY, ENGINE, fly, make_plan, run, sleep_and_fly, write_campaign
from programs import run_python

import abhv_mc
from abhv_mc.campaign.file.config import PROCESSES
from abhv_mc.custom_code.child import run_in_thread
from abhv_mc.execution import worker_processes as module
from abhv_mc.execution.executor import open_threads
from abhv_mc.execution.retry import FlightLostError, UnusableError
from abhv_mc.execution.worker_processes import WorkerPool
from abhv_mc.interfaces import Engine
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import find_input
from abhv_mc_vehicle.cli import flying
from abhv_mc_vehicle.flight.fly import nominal_parameters

PACKAGE = Path(abhv_mc.__file__).parent


@pytest.fixture
def pool():
    """Return a pool with one worker process that has computed a block."""
    with contextlib.closing(WorkerPool(fly, 1, 60.0, lambda process: "")) as pool:
        check_flight(pool)
        yield pool


PLAN = make_plan("one")


def check_flight(pool):
    """Check that a block of the pool equals one computed in this process."""
    parameters = nominal_parameters(3)
    np.testing.assert_array_equal(pool.fly(PLAN, parameters).metrics, fly(PLAN, parameters).metrics)


def find_worker(pool):
    (worker,) = pool._workers
    return worker.process.pid


def test_a_stopped_worker_is_replaced(pool, monkeypatch):
    monkeypatch.setattr(module, "_RESPONSE_LIMIT", 0.2)
    before = find_worker(pool)
    os.kill(before, signal.SIGSTOP)
    check_flight(pool)
    assert find_worker(pool) != before and not psutil.pid_exists(before)


def test_a_killed_fork_server_is_replaced(pool):
    before = find_worker(pool)
    server = psutil.Process(forkserver._forkserver._forkserver_pid)
    server.kill()
    os.kill(before, signal.SIGKILL)
    check_flight(pool)
    assert find_worker(pool) != before


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux")
def test_workers_ignore_interrupts(pool):
    """Ctrl-C reaches all processes of a terminal, and the parent handles it."""
    status = Path(f"/proc/{find_worker(pool)}/status").read_text("ascii")
    masks = [
        int(line.split()[1], 16)
        for line in status.splitlines()
        if line.startswith(("SigBlk:", "SigIgn:"))
    ]
    assert (masks[0] | masks[1]) & 1 << (signal.SIGINT - 1)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set())


FROM_PYTHON = """
import contextlib, os
from abhv_mc.execution.worker_processes import WorkerPool, start_fork_server
from abhv_mc_vehicle.flight.fly import nominal_parameters
from fake_flight import make_plan
from beside import fly
before = dict(os.environ)
start_fork_server(fly)
with contextlib.closing(WorkerPool(fly, 1, 60.0, lambda process: "")) as pool:
    assert pool.fly(make_plan("one"), nominal_parameters(3)).outcome.tolist() == [0, 0, 0]
assert before == dict(os.environ)
"""


def test_processes_import_from_the_scripts_folder_only(tmp_path, monkeypatch):
    """A random.py of the user would end the campaign; a foreign one would run."""
    (tmp_path / "here").mkdir()
    for name in ("abhv_mc", "multiprocessing", "numba", "numpy", "pickle", "random", "llvmlite"):
        (tmp_path / "here" / f"{name}.py").write_text(
            f"raise SystemExit('{name} of the working folder')\n"
        )
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/script.py").write_text(FROM_PYTHON)
    (tmp_path / "bin/beside.py").write_text("from fake_flight import fly\n")
    searched = os.pathsep.join(map(str, (PACKAGE.parent, Path(__file__).parents[1])))
    environment = {**os.environ, "PYTHONPATH": searched}
    script = tmp_path / "bin/script.py"
    done = run_python(script, cwd=tmp_path / "here", env=environment, timeout=120.0)
    assert done.returncode == 0, done.stderr


def test_a_worker_imports_no_further_packages():
    code = f"""
import sys, {module.serve.__module__}, abhv_mc_vehicle.stability.fly_with_margins
print({{"scipy.special", "pyarrow", "pandas", "joblib"}} & set(sys.modules))
"""
    assert run_python("-c", code, check=True).stdout == "set()\n"


def test_an_interrupt_does_not_wait_for_flights():
    free = threading.Event()
    with contextlib.suppress(KeyboardInterrupt), open_threads(1) as threads:
        flying, waiting = threads.submit(free.wait), threads.submit(free.wait)
        raise KeyboardInterrupt
    assert not flying.done() and waiting.cancelled()
    free.set()


def test_a_limit_and_an_interrupt_end_the_wait_for_a_thread(monkeypatch):
    ended = threading.Event()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def never(*arguments, **options):
        assert threading.current_thread() is not threading.main_thread()
        os.kill(os.getpid(), signal.SIGINT)  # as a terminal does
        ended.wait()

    try:
        with pytest.raises(KeyboardInterrupt):
            run_in_thread(never)
        monkeypatch.setattr("abhv_mc_vehicle.one_flight.fly_once.fly_plan", never)
        with pytest.raises(KeyboardInterrupt):
            flying.fly(find_input("level", "mission"), controllers="lqr")
        with pytest.raises(TimeoutError):
            run_in_thread(ended.wait, 0.05)
    finally:
        ended.set()
        signal.signal(signal.SIGINT, before)


def run_in_pool(campaign, out):
    """Run a campaign inside a process of multiprocessing.Pool, which may start no processes."""
    assert multiprocessing.current_process().daemon
    return run(campaign, out, replace(ENGINE, isolation=PROCESSES)).manifest.digest


def test_a_campaign_runs_inside_a_pool(tmp_path):
    campaign = write_campaign(tmp_path / "inputs", runs="64")
    demanding = write_campaign(tmp_path / "others", runs="64", execution="{isolation: processes}")
    digest = run(campaign, tmp_path / "alone").manifest.digest
    with multiprocessing.get_context("forkserver").Pool(1) as pool:
        assert pool.apply(run_in_pool, (campaign, tmp_path / "out")) == digest
        with pytest.raises(InputError, match="ProcessPoolExecutor"):
            pool.apply(run_in_pool, (demanding, tmp_path / "none"))


def test_an_engine_with_defaults_can_be_sent_to_another_process():
    engine = pickle.loads(pickle.dumps(Engine(None, fly, "")))  # noqa: S301
    assert engine.is_stability_compiled() and engine.describe_crash(3) == ""
    engine.close()


def test_a_flight_may_take_longer_than_its_limit_on_processor_time(monkeypatch):
    """A flight that sleeps for 0.5 s may take the larger of two wall times."""
    plan, parameters = make_plan("one"), nominal_parameters(3)
    monkeypatch.setattr(module, "_WALL", 2.0)
    for asleep, limit, ends in ((60.0, 0.2, True), (0.01, 10.0, True), (0.01, 0.2, False)):
        monkeypatch.setattr(module, "_ASLEEP", asleep)
        with contextlib.closing(WorkerPool(sleep_and_fly, 1, limit, lambda process: "")) as pool:
            if ends:
                assert pool.fly(plan, parameters).outcome.tolist() == [0, 0, 0]
            else:
                with pytest.raises(FlightLostError) as caught:
                    pool.fly(plan, parameters)
                assert caught.value.hung


def fly_or_end(plan, parameters, record_every=None):
    """End the process if the plan's gain or a density is negative; -9 is the signal of a kill."""
    density = parameters[:, DENSITY].min(initial=1.0)
    if (number := min(plan.gains[0, 0], density)) < 0.0:
        os.kill(os.getpid(), -int(number))
    return fly(plan, parameters, record_every)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGABRT])
def test_a_process_that_ends_in_a_flight_loses_only_its_block(number):
    rows = nominal_parameters(3)
    rows[1, DENSITY] = -number
    describe = lambda process: f" in {process}"  # noqa: E731
    with contextlib.closing(WorkerPool(fly_or_end, 1, 60.0, describe)) as pool:
        check_flight(pool)
        before = find_worker(pool)
        with pytest.raises(FlightLostError, match=f"in {before}$") as caught:
            pool.fly(PLAN, rows)
        assert caught.value.process and not caught.value.hung
        assert not pool._workers and pool._failed_starts == 0
        check_flight(pool)
        assert find_worker(pool) != before


@pytest.mark.parametrize(("number", "starts"), [(signal.SIGKILL, 5), (signal.SIGABRT, 2)])
def test_crashes_before_any_flight_count_four_times(monkeypatch, number, starts):
    monkeypatch.setattr(module, "_FAILED_STARTS", 4)
    monkeypatch.setattr(module, "_PAUSE", 0.0)
    started, make = [], module._Worker.__init__

    def note(self, *arguments):
        started.append(self)
        make(self, *arguments)

    monkeypatch.setattr(module._Worker, "__init__", note)
    plan = replace(make_plan("one", -float(number)))
    pool = WorkerPool(fly_or_end, 1, 60.0, lambda process: "")
    with contextlib.closing(pool), pytest.raises(UnusableError, match="isolation: threads"):
        pool.fly(plan, nominal_parameters(1))
    assert len(started) == starts


def hang(plan, parameters, record_every=None):
    threading.Event().wait()


def test_a_closed_pool_ends_its_flights_and_starts_none():
    pool = WorkerPool(hang, 1, 600.0, lambda process: "")
    threading.Timer(0.25, pool.close).start()
    for _ in range(2):
        with pytest.raises(UnusableError, match="stopped"):
            pool.fly(PLAN, nominal_parameters(1))
