"""What is compiled ahead is what a plan needs; and only where it is worth a process."""

import os
import subprocess
import sys

import pytest

from abhv_mc import jit
from abhv_mc.flight import ahead
from abhv_mc.flight.fly import flight_arguments, make_results, nominal_parameters
from abhv_mc.flight.plan import LANES
from abhv_mc.flight.prepare import prepare
from abhv_mc.machine_code import flatten


@pytest.mark.parametrize("controller", ["tlc", "lqr"])
@pytest.mark.parametrize("vehicle", ["ghame_x", "winged_cone"])
def test_any_plan_flies_what_was_compiled_without_one(repository, tmp_path, monkeypatch, vehicle, controller):
    monkeypatch.setattr("abhv_mc.flight.kept_plans.cache_folder", lambda: tmp_path)  # the plan is made, then recalled
    configs = repository / "configs"
    files = configs / f"vehicle/{vehicle}.yaml", configs / "mission/level.yaml", configs / f"control/{controller}.yaml"
    blank, _ = flatten(ahead.blank_arguments())
    for _ in range(2):
        plan = prepare(*files, controller)
        results = make_results(plan, 5, 10, True)
        kinds, _ = flatten(flight_arguments(plan, nominal_parameters(5), results, 10, LANES))
        assert kinds == blank


@pytest.fixture
def started(tmp_path, monkeypatch):
    """The commands that would have been started; nothing is kept, and there are two cores."""
    commands = []
    monkeypatch.setattr(ahead, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(ahead, "_started", [])
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1}, raising=False)
    monkeypatch.setattr(subprocess, "Popen", lambda command, **_: commands.append(command))
    (tmp_path / "kernels").mkdir()
    (tmp_path / "kernels" / "fly_lanes-0.lock").touch()
    return commands


def test_another_process_compiles_and_that_is_announced(started):
    said = []
    jit.on_first_compile(lambda: said.append("compiling"))
    ahead.compile_ahead()
    assert started == [[sys.executable, "-P", "-m", "abhv_mc.flight.ahead"]] and said == ["compiling"]


def test_kept_code_needs_no_process(started, tmp_path):
    (tmp_path / "kernels" / "fly_lanes-0").touch()
    ahead.compile_ahead()
    assert not started


def test_a_single_core_has_nothing_to_gain(started, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0}, raising=False)
    ahead.compile_ahead()
    assert not started


def test_a_machine_that_starts_no_process_is_no_obstacle(started, monkeypatch):
    def refuse(*_, **__):
        raise BlockingIOError

    monkeypatch.setattr(subprocess, "Popen", refuse)
    ahead.compile_ahead()


def test_the_process_leaves_the_flight_compiled(tmp_path):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    script = "import sys; from abhv_mc.flight.ahead import _load_flight; _load_flight(); print('numba' in sys.modules)"
    for _ in range(2):  # the first may compile
        done = subprocess.run(
            [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
        )
    assert done.stdout == "False\n"
