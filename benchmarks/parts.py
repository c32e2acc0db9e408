"""Time of each part of a control tick as a share of the time of a flight.

    python -m benchmarks.parts [--processes 3] [--json FILE]
    python -m benchmarks.parts --once        one process, printed only

Each part is measured alone with all lanes of a batch, and then finds its data in the nearest cache.
In a flight the parts alternate and lanes are in different table cells, which is why the sum is less
than the time of the flight. The results are written to ``benchmarks/results/parts.json`` and
``benchmarks/results/parts.md``.
"""

import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flights.blocks import Recording
from abhv_mc_vehicle.flight.arguments import make_kernel_plan, make_results
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.kernel.flight import observe
from abhv_mc_vehicle.kernel.flight.fly_lanes import evaluate, find_active, observe_tick, start_lanes
from abhv_mc_vehicle.kernel.flight.interface import LANES, has_width, make_memory
from abhv_mc_vehicle.kernel.flight.navigation import navigate
from abhv_mc_vehicle.kernel.flight.sensors import add_biases, sense
from abhv_mc_vehicle.kernel.jit import kernel
from abhv_mc_vehicle.kernel.laws.lqr import lqr_tick
from abhv_mc_vehicle.kernel.laws.tlc import (
    T_LIFT,
    nominal_variables,
    nominal_vehicle,
    tlc_attitude,
    tlc_guidance,
)
from abhv_mc_vehicle.kernel.laws.trim_lookup import look_up_trim
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import FIRST_EFFECTOR
from abhv_mc_vehicle.kernel.plant.actuators import run_actuators, set_actuators
from abhv_mc_vehicle.kernel.plant.aerodynamics import build_up, find_cells, interpolate_groups
from abhv_mc_vehicle.kernel.plant.air_data import air_data, deflections
from abhv_mc_vehicle.kernel.plant.disturbance import calm, disturb
from abhv_mc_vehicle.kernel.plant.effectors import place_effectors
from abhv_mc_vehicle.kernel.plant.runge_kutta import (
    equations_of_motion,
    finish_step,
    runge_kutta_stage,
)
from benchmarks.document import replace_part, write_json
from benchmarks.speed import make_work, read_operations
from benchmarks.spread import Spread, describe_machine, find_spreads, make_note, make_parser, repeat
from benchmarks.timing import measure_time

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "parts.json"
DOCUMENT = ROOT / "benchmarks" / "results" / "parts.md"
REPEATS = 9

# name: (number in the kernel, calls per tick, control laws that use it)
BOTH = ("tlc", "lqr")
PARTS = {
    "air data: atmosphere, flow angles": (0, 4, BOTH),
    "effective deflections": (1, 4, BOTH),
    "tables: find the cells": (2, 4, BOTH),
    "tables: interpolate": (3, 4, BOTH),
    "build-up of the coefficients": (4, 4, BOTH),
    "equations of motion, Runge-Kutta": (5, 4, BOTH),
    "actuators": (6, 1, BOTH),
    "end of the step": (7, 1, BOTH),
    "navigation, disturbances, sensors": (8, 1, BOTH),
    "outcome and metrics": (9, 1, BOTH),
    "LQR": (10, 1, ("lqr",)),
    "TLC: guidance loops": (11, 1, ("tlc",)),
    "TLC: nominal vehicle and its slopes": (12, 1, ("tlc",)),
    "TLC: trim data": (13, 1, ("tlc",)),
    "TLC: attitude loops and allocation": (14, 1, ("tlc",)),
}
SLOW, REST = "divisions and roots in these parts", "the flight apart from these parts"
N = 1024  # size of arrays that fit into the nearest cache


@kernel
def run_part(plan, lqr_plan, memory, results, number, calls):
    """Run one part ``calls`` times at the start of the mission, with the plan of TLC or LQR."""
    if not has_width(memory, LANES):
        return 0.0
    Z, O, T, cells = memory.Z, memory.O, memory.T, memory.cells
    vehicle, reference, gains, settings = plan.vehicle, plan.reference, plan.gains, plan.settings
    earth, step = plan.earth, plan.timing.step
    width = Z.shape[1]
    for lane in range(width):
        memory.order[lane] = lane
    start_lanes(plan, memory, width, find_active, memory.order, width)
    still = runge_kutta_stage(0, 0.0)  # does not change the state
    active = find_active(Z, width, plan)
    evaluate(plan, memory, width, still, active)
    for _ in range(calls):
        if number == 0:
            air_data(Z, width, vehicle, earth, False)
        elif number == 1:
            deflections(Z, width)
            place_effectors(Z, memory.A, width, vehicle, False, -1)
        elif number == 2:
            find_cells(Z, width, vehicle.tables, cells)
        elif number == 3:
            interpolate_groups(T, width, vehicle.tables, cells)
        elif number == 4:
            build_up(Z, T, width, vehicle.build_up, vehicle.build_up.factor)
        elif number == 5:
            equations_of_motion(Z, width, vehicle, earth, still, active)
        elif number == 6:
            run_actuators(Z, Z, width, vehicle.actuators, 0, FIRST_EFFECTOR, step, False, active)
            set_actuators(Z, width)
        elif number == 7:
            finish_step(Z, width, step, O[observe.ALIVE])
        elif number == 8:
            navigate(Z, width, step, False)
            calm(Z, width)
            disturb(Z, width, plan.vehicle.constants.span, active.disturbances, step, step, False)
            add_biases(Z, width)
            sense(Z, width, active.sensor_errors, step, 1)
        elif number == 9:
            observe_tick(plan, memory, results, width, active, memory.order, width, 1)
        elif number == 10:
            lqr_tick(lqr_plan, memory, width, 1)
        elif number == 11:
            tlc_guidance(Z, width, vehicle, reference, gains, settings, 1, step)
        elif number == 12:
            nominal_variables(Z, width, vehicle, reference, 1)
            nominal_vehicle(plan, memory, width, active)
        elif number == 13:
            look_up_trim(Z, width, plan.trim_tables, memory.trim, s.ALPHA_CMD, s.CMD_ETA, T_LIFT)
        elif number == 14:
            tlc_attitude(Z, width, vehicle, earth, reference, gains, settings, 1, step, False)
    return Z[s.X, 0]


@kernel
def divide(x, y, out, times):
    for time in range(times):
        x[0] = float(time)  # makes each pass different
        for i in range(x.size):
            out[i] = x[i] / y[i]


@kernel
def take_roots(x, y, out, times):
    for time in range(times):
        x[0] = float(time)
        for i in range(x.size):
            out[i] = math.sqrt(x[i] + y[i])


def time_of_one(operation: Callable[..., None]) -> float:
    """Return the median time of one operation in a loop over arrays, s."""
    x, y, out = np.full(N, 2.0), np.full(N, 1.5), np.empty(N)

    operation(x, y, out, 1)
    return median(measure_time(lambda: operation(x, y, out, 10_000)) for _ in range(REPEATS)) / (
        10_000 * N
    )


def time_of(number: int, calls: int, plans: dict[str, FlightPlan], parameters: Floats) -> float:
    """Return the median processor time of ``calls`` calls with all lanes, s."""
    tlc, lqr = (make_kernel_plan(plans[law], parameters, Recording(0)) for law in BOTH)
    memory, results = make_memory(LANES), make_results(plans["tlc"], LANES, Recording(0), False)
    run_part(tlc, lqr, memory, results, number, 1)
    return median(
        measure_time(lambda: run_part(tlc, lqr, memory, results, number, calls))
        for _ in range(REPEATS)
    )


def measure_parts() -> dict[str, dict[str, float]]:
    """Return the time per flight in ms by law and part.

    ``flight`` is the complete flight, and ``SLOW`` the time of divisions and roots alone.
    """
    plans, parameters = make_work(LANES)
    ticks = plans["tlc"].timing.ticks
    seconds = {
        name: time_of(number, ticks * calls, plans, parameters)
        for name, (number, calls, _) in PARTS.items()
    }
    division, root = time_of_one(divide), time_of_one(take_roots)
    counts = read_operations()
    times = {}
    for law, plan in plans.items():
        ms = {
            name: 1e3 * seconds[name] / LANES for name, (_, _, laws) in PARTS.items() if law in laws
        }
        fly(plan, parameters)
        flight_time = median(
            measure_time(lambda plan=plan: fly(plan, parameters)) for _ in range(REPEATS)
        )
        slow = counts[law]["divisions"] * division + counts[law]["square_roots"] * root
        times[law] = {**ms, "flight": 1e3 * flight_time / LANES, SLOW: 1e3 * slow}
    return times


def find_shares(parts: dict[str, float]) -> dict[str, float]:
    """Return the parts of a law as shares of its flight in the same process, and the remainder."""
    flight_time = parts["flight"]
    shares = {name: ms / flight_time for name, ms in parts.items() if name != "flight"}
    return {**shares, REST: 1.0 - sum(share for name, share in shares.items() if name != SLOW)}


def make_record(
    machine: dict[str, Any],
    runs: list[dict[str, dict[str, float]]],
    shares: dict[str, dict[str, Spread]],
) -> dict[str, Any]:
    """Return the record to store: medians in ms by law, and shares with their range."""
    ms = {
        law: {
            name: round(spread.median, 4)
            for name, spread in find_spreads([run[law] for run in runs]).items()
        }
        for law in BOTH
    }
    ends = {
        key: {
            law: {name: round(getattr(spread, end), 5) for name, spread in shares[law].items()}
            for law in BOTH
        }
        for key, end in {"shares": "median", "lowest": "lowest", "highest": "highest"}.items()
    }
    return {**ms, "machine": machine, "processes": len(runs), **ends}


def make_table(
    machine: dict[str, Any], processes: int, shares: dict[str, dict[str, Spread]]
) -> str:
    """Return the medians as Markdown, in per cent; their range is in the record."""
    lines = [make_note(machine, processes), ""]
    lines += [f"| part ({machine['simd']}) | TLC | LQR |", "|---|---|---|"]
    for name in (*PARTS, SLOW, REST):
        cells = [
            f"{100 * shares[law][name].median:.1f} %" if name in shares[law] else "" for law in BOTH
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    parser = make_parser(__doc__, RESULT)
    parser.add_argument(
        "--once", action="store_true", help="measure in this process, print JSON, write nothing"
    )
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    options = parser.parse_args()
    if options.once or options.smoke:
        print(json.dumps(measure_parts()))
        return
    load = os.getloadavg()[0]
    runs = repeat(options.processes, "benchmarks.parts", "--once")
    shares = {law: find_spreads([find_shares(run[law]) for run in runs]) for law in BOTH}
    machine = describe_machine(load)
    write_json(options.json, make_record(machine, runs, shares))
    table = make_table(machine, len(runs), shares)
    replace_part(DOCUMENT, "parts", table)
    print(table)


if __name__ == "__main__":
    main()
