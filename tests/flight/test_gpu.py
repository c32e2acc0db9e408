"""The GPU's kernel without a GPU: flown on the simulator, and compiled to PTX."""

import dataclasses
import importlib.util
import os
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from short_flights import rows_of, short_plan

from abhv_mc.flight.fly import fly
from abhv_mc.flight.outcome import Outcome

TICKS = 7
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def plans():
    return {name: short_plan(TICKS, name, vehicle="ghame_x_coupled") for name in ("tlc", "lqr")}


@pytest.fixture(scope="module")
def dispersed():
    """Five flights: dispersed ones, and in the middle one that breaks at once."""
    return rows_of(
        {},
        {"atmosphere.density": 1.2},
        {"mass.total": np.nan},
        {"initial.angle_of_attack": 0.01},
        {"wind.east": 30.0},
    )


def run(script, folder, *arguments, **variables):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **variables}
    command = [sys.executable, str(HERE / script), *map(str, arguments)]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_simulated_device_flies_the_same_bits(plans, dispersed, tmp_path):
    path = tmp_path / "plans.pickle"
    path.write_bytes(pickle.dumps((plans, dispersed)))
    run("simulate_kernel.py", tmp_path, path, NUMBA_ENABLE_CUDASIM="1", NUMBA_DISABLE_JIT="1")
    flown = pickle.loads(path.with_name("flown.pickle").read_bytes())  # noqa: S301
    for law, plan in plans.items():
        here = fly(plan, dispersed, record_every=2, keep_states=True)
        assert here.outcome.tolist() == [Outcome.OK] * 2 + [Outcome.NOT_FINITE] + [Outcome.OK] * 2
        for field in dataclasses.fields(here):
            mine, theirs = getattr(here, field.name), getattr(flown[law], field.name)
            if not isinstance(mine, np.ndarray):  # extremes, which no thread keeps, and who flew
                assert mine == theirs
                continue
            assert mine.dtype == theirs.dtype
            assert np.array_equal(mine, theirs, equal_nan=mine.dtype.kind == "f"), (law, field.name)


@pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("numba_cuda", "nvidia")),
    reason="numba-cuda and nvidia-nvvm, which compile for a GPU, are not installed",
)
def test_the_kernel_compiles_and_rounds_after_every_operation(plans, dispersed, tmp_path):
    # One law: every law's code is in the kernel until its branch is pruned.
    path, ptx_path = tmp_path / "plan.pickle", tmp_path / "kernel.ptx"
    path.write_bytes(pickle.dumps((plans["tlc"], dispersed)))
    run("compile_kernel.py", tmp_path, path, ptx_path)
    ptx = ptx_path.read_text()
    assert ptx.count(".entry") == 1
    assert ".extern .func" not in ptx  # all of it is there
    floating = set(re.findall(r"\b(?:add|sub|mul|div|sqrt|rcp|fma|mad)\.[\w.]*f64", ptx))
    # IEEE-rounded operations one by one: no fused multiply-add, no approximation, and none left for ptxas to fuse.
    assert floating == {f"{name}.rn.f64" for name in ("add", "sub", "mul", "div", "sqrt", "rcp")}
    assert not re.search(r"\.(?:ftz|approx)", ptx)
