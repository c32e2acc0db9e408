"""The flight compiled in a process of its own, while this one prepares what is to be flown.

What is compiled depends on the types of a plan, and those are always the same: a plan without a mission will do.
"""

import contextlib
import gc
import os
import subprocess
import sys
from typing import Any

import numpy as np

from abhv_mc.code_cache import cache_folder
from abhv_mc.jit import announce_compiling

_started: list["subprocess.Popen[bytes]"] = []  # nobody waits for them: whoever needs the code does that


def compile_ahead() -> None:
    """Have another process compile the flight where that has not been done, and this one has a core to spare.

    Whoever flies waits for that process, or compiles where it fails (:func:`abhv_mc.code_cache.one_at_a_time`).
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    kept = any(file.suffix == "" for file in (cache_folder() / "kernels").glob("fly_lanes-*"))
    if kept or cores < 2:
        return
    announce_compiling()
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    nothing = subprocess.DEVNULL
    with contextlib.suppress(OSError):
        _started.append(
            subprocess.Popen(
                [sys.executable, "-P", "-m", "abhv_mc.flight.ahead"],
                env=environment,
                stdin=nothing,
                stdout=nothing,
                stderr=nothing,
            )
        )


def blank_arguments() -> tuple[Any, ...]:
    """Arguments of the compiled flight that are of the right types and fly nowhere."""
    from abhv_mc.control.columns import REFERENCE
    from abhv_mc.flight.fly import flight_arguments, make_results, nominal_parameters
    from abhv_mc.flight.plan import LANES, FlightPlan, Limits, Timing
    from abhv_mc.plant.effectiveness import make_effectiveness
    from abhv_mc.plant.state import N_STATES
    from abhv_mc.plant.vehicles import load_vehicle
    from abhv_mc.shipped import shipped_configs
    from abhv_mc.world.earth import WGS84

    vehicle = load_vehicle(shipped_configs() / "vehicle" / "ghame_x.yaml")
    plan = FlightPlan(
        controller="none",
        law="recorded",
        vehicle=vehicle,
        trim_tables=vehicle.tables,
        effectiveness=make_effectiveness(vehicle),
        earth=WGS84,
        timing=Timing(0.01, 1, 0),
        limits=Limits(0.0, 0.0, 0.0, 0.0, 0.0),
        initial_state=np.zeros(N_STATES),
        reference=np.zeros((1, len(REFERENCE))),
        gains=np.zeros((1, 1)),
        settings=np.zeros(1),
    )
    parameters = nominal_parameters()
    results = make_results(plan, len(parameters), 0, False)
    return flight_arguments(plan, parameters, results, 0, LANES)


def _load_flight() -> None:
    from abhv_mc.flight.fly import compiled_flight
    from abhv_mc.flight.plan import LANES

    compiled_flight(LANES).load(*blank_arguments())


if __name__ == "__main__":
    gc.disable()  # a short life
    _load_flight()
