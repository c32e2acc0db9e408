"""The counting of operations: each kind by hand, and a flight's against the flight itself."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from short_flights import cut

from abhv_mc.bench.speed import make_work, read_operations
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.folder.plan_file import write_plan
from benchmarks.counted import COUNTS, Counted, counted_sqrt
from benchmarks.operations import count_operations


@pytest.fixture(autouse=True)
def from_zero():
    COUNTS.clear()


@pytest.mark.parametrize("other", [3.0, np.float64(3.0), 3, Counted(3.0)])
def test_each_operation_counts_once_from_either_side(other):
    x = Counted(2.0)
    results = [x + other, other + x, x - other, other - x, x * other, other * x, x / other, other / x]
    assert results == [5.0, 5.0, -1.0, 1.0, 6.0, 6.0, 2.0 / 3.0, 1.5]
    assert all(isinstance(result, Counted) for result in results)
    assert COUNTS == {"additions": 4, "multiplications": 2, "divisions": 2}


def test_what_is_no_arithmetic_does_not_count():
    x = Counted(-4.0)
    assert (-x, abs(x), min(x, 1.0), int(x), x < 1.0, math.isnan(x)) == (4.0, 4.0, -4.0, -4, True, False)
    assert not COUNTS
    assert counted_sqrt(abs(x)) * 1.0 == 2.0
    assert COUNTS == {"square_roots": 1, "multiplications": 1}
    with pytest.raises(TypeError, match="products"):
        x**2.0


@pytest.fixture(scope="module")
def plans():
    return make_work(1)[0]


def test_the_counts_that_the_package_keeps_are_todays(plans):
    assert count_operations(plans) == read_operations(), "count again: python -m benchmarks.operations"


COUNTED_FLIGHT = """
import sys, numpy as np
from dataclasses import replace
from pathlib import Path
from benchmarks import operations
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.simulators.stored_plans import read_plan
from abhv_mc.shipped import find_input
from abhv_mc.user_code.vehicle_functions import load_vehicle
plan = read_plan(Path(sys.argv[1]), load_vehicle(find_input("ghame_x", "vehicle")))
operations._use_counted_floats()
np.save(sys.argv[2], fly(plan, nominal_parameters(), lanes=1).metrics)
"""


def test_counted_floats_fly_the_same_flight(plans, tmp_path):
    short = cut(plans["tlc"], 8)
    write_plan(tmp_path / "plan.npz", short)
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", COUNTED_FLIGHT, tmp_path / "plan.npz", tmp_path / "metrics.npy"]
    subprocess.run(command, env=environment, check=True)
    assert np.array_equal(np.load(tmp_path / "metrics.npy"), fly(short, nominal_parameters()).metrics)
