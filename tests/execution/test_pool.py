"""Worker processes that stand still or lose the process they were forked from are replaced; flights are as ever."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
from multiprocessing import forkserver
from pathlib import Path

import numpy as np
import psutil
import pytest
from fake_flight import fly, make_plan

import abhv_mc
from abhv_mc.execution import pool as module
from abhv_mc.execution.pool import WorkerPool
from abhv_mc.execution.retry import UnusableError
from abhv_mc.flight.fly import nominal_parameters

PACKAGE = Path(abhv_mc.__file__).parent


@pytest.fixture
def pool():
    """One worker process that has flown."""
    with contextlib.closing(WorkerPool(fly, 1, 60.0)) as pool:
        check_flight(pool)
        yield pool


PLAN = make_plan("one")


def check_flight(pool):
    """A block as this process flies it."""
    parameters = nominal_parameters(3)
    np.testing.assert_array_equal(pool.fly(PLAN, parameters).metrics, fly(PLAN, parameters).metrics)


def find_worker(pool):
    (worker,) = pool._workers
    return worker.process.pid


def test_a_worker_that_stands_still_is_replaced(pool, monkeypatch):
    monkeypatch.setattr(module, "_RESPONSE_LIMIT", 0.2)
    pool._limit = 0.2
    before = find_worker(pool)
    os.kill(before, signal.SIGSTOP)
    monkeypatch.setattr(module, "time_limit", lambda flights, one: one if find_worker(pool) == before else 60.0)
    check_flight(pool)
    assert find_worker(pool) != before and not psutil.pid_exists(before)


def test_without_the_server_that_workers_are_forked_from(pool):
    before = find_worker(pool)
    server = psutil.Process(forkserver._forkserver._forkserver_pid)
    server.kill()
    os.kill(before, signal.SIGKILL)
    check_flight(pool)
    assert find_worker(pool) != before


def test_while_the_server_is_dying(pool, monkeypatch):
    """Nobody hears it at its address any more, and it does not count as ended yet: the next starts are refused."""
    asked, revive = [], forkserver._forkserver.ensure_running

    def believe_it_runs():
        asked.append(True)
        if len(asked) > 3:
            revive()

    monkeypatch.setattr(forkserver._forkserver, "ensure_running", believe_it_runs)
    server = psutil.Process(forkserver._forkserver._forkserver_pid)
    server.kill()
    while server.status() != psutil.STATUS_ZOMBIE:
        pass
    os.kill(find_worker(pool), signal.SIGKILL)
    check_flight(pool)
    assert len(asked) == 4 and pool._failed_starts == 0


def test_no_process_can_be_started(pool, monkeypatch):
    """The message says why, and nothing stays open."""
    monkeypatch.setattr(module, "_PAUSE", 0.0)

    def refuse():
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(forkserver._forkserver, "ensure_running", refuse)
    os.kill(find_worker(pool), signal.SIGKILL)
    descriptors = psutil.Process().num_fds()
    with pytest.raises(UnusableError, match=r"Too many open files.*isolation: threads"):
        check_flight(pool)
    assert psutil.Process().num_fds() <= descriptors


def test_a_closed_pool_starts_no_process(pool):
    pool.close()
    with pytest.raises(UnusableError, match="stopped"):
        check_flight(pool)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux")
def test_workers_hear_no_interrupt(pool):
    """Ctrl-C goes to everyone in a terminal; the parent decides what it means."""
    status = Path(f"/proc/{find_worker(pool)}/status").read_text(encoding="ascii")
    masks = [int(line.split()[1], 16) for line in status.splitlines() if line.startswith(("SigBlk:", "SigIgn:"))]
    assert (masks[0] | masks[1]) & 1 << (signal.SIGINT - 1)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set())


SHADOWED = ("abhv_mc", "multiprocessing", "numba", "numpy", "pickle", "llvmlite", "campaign")


@pytest.fixture
def hostile(tmp_path, monkeypatch):
    """The working folder: files under the names of modules, which say so when they are imported."""
    folder = tmp_path / "hostile"
    folder.mkdir()
    for name in SHADOWED:
        said = f"open({str(tmp_path / 'ran')!r}, 'a').write('{name} ')"
        (folder / f"{name}.py").write_text(f"{said}\nraise ImportError('{name} of the working folder')\n")
    monkeypatch.chdir(folder)
    yield folder
    assert not (tmp_path / "ran").exists(), (tmp_path / "ran").read_text()


CONSOLE = "from abhv_mc.cli.app import main\nmain()\n"
FROM_PYTHON = """
import contextlib, os
from multiprocessing import util
from abhv_mc.execution.pool import WorkerPool, start_fork_server
from abhv_mc.flight.fly import nominal_parameters
from fake_flight import make_plan
from beside import fly
before = dict(os.environ)
start_fork_server(fly)
with contextlib.closing(WorkerPool(fly, 1, 60.0)) as pool:
    pool.fly(make_plan("one"), nominal_parameters(3))
assert before == dict(os.environ)
print(util.get_temp_dir())
"""
BESIDE = """
import os
import fake_flight
def fly(plan, parameters, every=None):
    found = {name: os.environ.get(name) for name in ("PYTHONPATH", "PYTHONSAFEPATH")}
    raise ValueError(f"found {found}")
"""


def run_script(folder, text, *words, **environment):
    """Python on a file in a folder of its own, as a console script or a user's own is started."""
    (folder / "bin").mkdir()
    script = folder / "bin" / "script.py"
    script.write_text(text)
    (folder / "bin" / "beside.py").write_text(BESIDE)
    searched = os.pathsep.join(map(str, (PACKAGE.parent, Path(__file__).parents[2])))
    environment = {**os.environ, "PYTHONPATH": searched, **environment}
    done = subprocess.run(
        [sys.executable, script, *words], env=environment, capture_output=True, text=True, check=False
    )
    return searched, done


COMMANDS = {"run": ["--no-report"], "worst": ["--metric", "sideslip_max_deg", "--flights", "160"]}


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_is_imported_from_the_working_folder(hostile, tmp_path, repository, command):
    """It was run with the user's rights: multiprocessing starts processes of its own with ``python -c``."""
    configs = repository / "configs"
    mission = (configs / "mission" / "level.yaml").read_text()
    lines = ["duration: 1 s" if line.startswith("duration") else line for line in mission.splitlines()]
    (tmp_path / "mission.yaml").write_text("\n".join(lines) + "\n")
    (tmp_path / "campaign.yaml").write_text(
        f"name: short\nvehicle: {configs}/vehicle/ghame_x.yaml\nmission: mission.yaml\n"
        f"controllers: {{lqr: {configs}/control/lqr.yaml}}\nruns: 24\nseed: 1\n"
        "dispersions:\n  aero.lift: {distribution: uniform, half_width: 10 %}\nexecution: {workers: 1}\n"
    )
    file, out = tmp_path / "campaign.yaml", tmp_path / "out"
    _, done = run_script(tmp_path, CONSOLE, command, file, "-o", out, *COMMANDS[command])
    assert done.returncode == 0, done.stderr


def test_processes_import_from_where_the_caller_does(hostile, tmp_path):
    """Not from the working folder, but from beside his script; variables are as he has them, here and there."""
    searched, done = run_script(tmp_path, FROM_PYTHON)
    assert done.returncode == 0, done.stderr
    assert str({"PYTHONPATH": searched, "PYTHONSAFEPATH": None}) in done.stderr


def test_a_deep_temporary_folder_is_no_obstacle(tmp_path):
    """A socket's name has room for some hundred bytes; job folders on clusters are as long."""
    deep = tmp_path / ("d" * 100) / ("e" * 100)
    deep.mkdir(parents=True)
    _, done = run_script(tmp_path, FROM_PYTHON, TMPDIR=str(deep))
    assert done.returncode == 0, done.stderr
    assert "'PYTHONSAFEPATH': None" in done.stderr
    assert not Path(done.stdout.strip()).exists()


AGAIN = """
import contextlib, multiprocessing, sys
from abhv_mc.execution.pool import WorkerPool
from abhv_mc.flight.fly import nominal_parameters
from fake_flight import fly, make_plan

def again():
    with contextlib.closing(WorkerPool(fly, 1, 60.0)) as pool:
        pool.fly(make_plan("one"), nominal_parameters(3))

again()
process = multiprocessing.get_context("fork").Process(target=again)
process.start()
process.join(60)
sys.exit(process.exitcode)
"""


def test_a_process_that_was_forked_from_one_that_has_flown_flies(tmp_path):
    """multiprocessing forks on Linux unless told otherwise, and takes the parent's server for the child's own."""
    _, done = run_script(tmp_path, AGAIN)
    assert done.returncode == 0, done.stderr


BLOCKED = """
import contextlib, signal
from abhv_mc.execution.pool import WorkerPool
from abhv_mc.flight.fly import nominal_parameters
from fake_flight import fly, make_plan
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
with contextlib.closing(WorkerPool(fly, 1, 60.0)) as pool:
    pool.fly(make_plan("one"), nominal_parameters(3))
    (worker,) = pool._workers
    signal.alarm(30)
    worker.kill()
"""


def test_a_starter_that_blocks_sigchld_is_no_obstacle(tmp_path):
    """The mask is inherited: the server did not hear that a worker had ended, and whoever waited for it hung."""
    _, done = run_script(tmp_path, BLOCKED)
    assert done.returncode == 0, done.stderr


def test_a_process_that_may_start_no_others_says_so(monkeypatch):
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)
    with pytest.raises(UnusableError, match=r"multiprocessing\.Pool.*isolation: threads"):
        WorkerPool(fly, 1, 60.0)
