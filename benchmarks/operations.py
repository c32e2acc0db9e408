"""Number of floating-point operations of a flight, counted in plain Python.

    python -m benchmarks.operations        counts the default campaign's flights

The results are written to benchmarks/operations.json.

Operations are counted on values that depend on the lane: the state, the dispersions, the values of
tables and all results of these. Not counted are operations on values that all lanes share
(constants, gains and references of a tick, and weights computed from these), comparisons,
selections, conversions and look-ups. If there are two branches, the executed branch is counted.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc_vehicle.flight.plan import FlightPlan
from benchmarks.document import write_json
from benchmarks.speed import OPERATIONS_FILE, make_work

_FIRST, _LAST = 5, 25  # ticks, after the start-up of differentiators and search hints


def count_operations(plans: dict[str, FlightPlan]) -> dict[str, dict[str, int]]:
    """Return the operations of each plan's flight, counted in a process without compiled code."""
    from abhv_mc.folder.opening import write_plan

    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for name, plan in plans.items():
            paths.append(Path(folder) / f"{name}.npz")
            write_plan(paths[-1], plan)
        command = [sys.executable, "-m", "benchmarks.operations", *map(str, paths)]
        environment = {
            **os.environ,
            "NUMBA_DISABLE_JIT": "1",
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        }
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return {
        name: {kind: round(n) for kind, n in counts.items()}
        for name, counts in json.loads(done.stdout).items()
    }


def _count(plan: FlightPlan, ticks: int) -> dict[str, int]:
    """Return the operations of the first ``ticks`` ticks of a flight."""
    from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
    from benchmarks.counted import COUNTS

    COUNTS.clear()
    fly(replace(plan, timing=plan.timing._replace(ticks=ticks)), nominal_parameters(), lanes=1)
    return dict(COUNTS)


def _count_flight(plan: FlightPlan) -> dict[str, float]:
    """Return the operations of a flight, extrapolated from the counted ticks."""
    from benchmarks.counted import make_counted

    tables = plan.vehicle.tables._replace(data=make_counted(plan.vehicle.tables.data))
    trim = plan.trim_tables._replace(data=make_counted(plan.trim_tables.data))
    counted = replace(plan, vehicle=plan.vehicle._replace(tables=tables), trim_tables=trim)
    few, many = _count(counted, _FIRST), _count(counted, _LAST)
    repetitions = (plan.timing.ticks - _FIRST) / (_LAST - _FIRST)
    return {kind: few[kind] + repetitions * (many[kind] - few[kind]) for kind in many}


def _use_counted_floats() -> None:
    """Make the flight allocate counted arrays, and count square roots and assembled floats."""
    from abhv_mc_vehicle.flight import arguments
    from abhv_mc_vehicle.flight import fly as flights
    from abhv_mc_vehicle.kernel.flight.interface import make_memory
    from abhv_mc_vehicle.kernel.numerics import float_bits, lane_math
    from benchmarks.counted import Counted, counted_sqrt, make_counted

    def count_in(value: Any) -> Any:
        if isinstance(value, tuple):
            return type(value)(*map(count_in, value))
        return make_counted(value) if value.dtype == np.float64 else value

    # The check of types rejects arrays of objects.
    arguments.conform = lambda value, *_: value
    flights.make_memory = lambda *sizes: count_in(make_memory(*sizes))  # type: ignore[attr-defined]
    lane_math.bits_float = lambda bits: Counted(float_bits.bits_float(bits))  # type: ignore[attr-defined]
    math.sqrt = counted_sqrt  # type: ignore[assignment]


def _main(paths: list[str]) -> None:
    if not paths:
        write_json(OPERATIONS_FILE, count_operations(make_work(1)[0]))
        return
    if paths == ["--smoke"]:
        name, plan = next(iter(make_work(1)[0].items()))
        print(count_operations({name: plan}))
        return
    if os.environ.get("NUMBA_DISABLE_JIT") != "1":
        raise SystemExit("counting needs NUMBA_DISABLE_JIT=1")
    from abhv_mc.folder.opening import read_plan
    from abhv_mc.shipped import find_input
    from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
    from abhv_mc_vehicle.vehicle_simulator.stored_plans import rebuild_plan

    rebuild = partial(rebuild_plan, vehicle=load_vehicle(find_input("ghame_x", "vehicle")))
    plans = {Path(path).stem: read_plan(Path(path), rebuild) for path in paths}
    _use_counted_floats()
    print(json.dumps({name: _count_flight(plan) for name, plan in plans.items()}))


if __name__ == "__main__":
    _main(sys.argv[1:])
