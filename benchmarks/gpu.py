"""Flights on a GPU: the same as on the processor? How many a second?

    pip install 'abhv-mc[gpu]'
    python benchmarks/gpu.py          # equality on 256 flights, then 1e4, 1e5 and 1e6 flights of each controller
    python benchmarks/gpu.py --registers 128 --threads 64 --flights 100000

Prints one JSON line a measurement. Exit code 1 where a flight differs from the processor's by more than
``--tolerance`` (relative to the metric's largest value; 0, the default, asks for the same bits), 2 without a GPU.
Only launches and copies are timed, after a first launch that compiles.
"""

import argparse
import json
import statistics
import sys
import time

import numpy as np

from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.gpu import THREADS, fly_on_gpu, kernel_of
from abhv_mc.flight.prepare import prepare
from abhv_mc.io.input_error import Refusal
from abhv_mc.jit_cuda import SIMULATED, find_device
from abhv_mc.plant.parameters import PARAMETERS
from abhv_mc.shipped import shipped_configs

CHECKED = 256
REPEATS = 3
EVERY = 10  # control ticks between samples of a history: 10 Hz, what envelopes are made of
WIDTH = {"-": 2e-3, "m": 0.5, "m/s": 3.0, "1/s": 1e-4, "rad": 2e-3, "rad/s": 1e-3, "s": 0.0}


def disperse(flights: int) -> np.ndarray:
    """Factors within 5 %, errors within the widths above."""
    widths = [0.05 if p.nominal and p.unit == "-" else WIDTH.get(p.unit, 0.0) for p in PARAMETERS]
    widths[0] = 0.0
    draws = np.random.default_rng(20).uniform(-1.0, 1.0, (flights, len(PARAMETERS)))
    return nominal_parameters(flights) + draws * widths


def compare(plan, options: dict) -> dict:
    """The largest differences between the GPU's flights and the processor's."""
    parameters = disperse(CHECKED)
    here, there = fly(plan, parameters, EVERY), fly_on_gpu(plan, parameters, EVERY, **options)
    same = (here.metrics == there.metrics) | (np.isnan(here.metrics) & np.isnan(there.metrics))
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.abs(there.metrics - here.metrics) / np.nanmax(np.abs(here.metrics), axis=0)
    relative = np.where(same, 0.0, np.nan_to_num(relative, nan=np.inf))
    return {
        "flights": CHECKED,
        "same_bits": bool(
            same.all()
            and np.array_equal(here.history, there.history, equal_nan=True)
            and np.array_equal(here.end_time, there.end_time)
        ),
        "same_outcomes": bool(np.array_equal(here.outcome, there.outcome)),
        "flights_that_differ": int((~same).any(axis=1).sum()),
        "largest_difference": float(relative.max()),
    }


def measure(plan, flights: int, every: int | None, options: dict) -> dict:
    parameters = disperse(flights)
    seconds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        fly_on_gpu(plan, parameters, every, **options)
        seconds.append(time.perf_counter() - start)
    return {
        "flights": flights,
        "history": every is not None,
        "seconds": statistics.median(seconds),
        "spread": max(seconds) - min(seconds),
        "flights_per_second": flights / statistics.median(seconds),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--laws", nargs="+", default=["tlc", "lqr"])
    parser.add_argument("--threads", type=int, default=THREADS, help="of a block")
    parser.add_argument("--registers", type=int, help="most registers of a thread")
    parser.add_argument("--tolerance", type=float, default=0.0)
    parser.add_argument("--histories", action="store_true", help="record at 10 Hz too")
    given = parser.parse_args()
    try:
        name = find_device()
    except Refusal as refusal:
        print(refusal, file=sys.stderr)
        return 2
    options = {"threads": given.threads, "max_registers": given.registers}
    configs = shipped_configs()
    wrong = False
    for law in given.laws:
        about = {"device": name, "law": law, **options}
        files = ("vehicle/ghame_x_coupled.yaml", "mission/s_manoeuvre.yaml", f"control/{law}.yaml")
        plan = prepare(*(configs / file for file in files), law)
        found = compare(plan, options)
        wrong |= not found["same_outcomes"] or found["largest_difference"] > given.tolerance
        if not SIMULATED:
            compiled = next(iter(kernel_of(plan, given.registers).overloads.values()))
            found |= {"registers": compiled.regs_per_thread, "local_bytes": compiled.local_mem_per_thread}
        print(json.dumps({"what": "equality", **about, **found}), flush=True)
        for flights in given.flights:
            found = measure(plan, flights, EVERY if given.histories else None, options)
            print(json.dumps({"what": "speed", **about, **found}), flush=True)
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
