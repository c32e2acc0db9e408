"""Speed of the compiled flight relative to the peak of a core, start-up times, memory.

Flights are measured in batches, one at a time, and on two threads. Single-core times are thread
times, so other programs have little influence on them; runs on two threads are measured in wall
time. The measurements alternate, so that a slowdown of the machine affects all of them. Start-up
times and memory are measured in separate processes.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.identity import find_machine
from abhv_mc.shipped import shipped_campaigns
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.prepare import prepare
from abhv_mc_vehicle.kernel.flight.interface import LANES
from abhv_mc_vehicle.kernel.jit import kernel

CONTROLLERS = ("tlc", "lqr")
OPERATIONS_FILE = Path(__file__).with_name(
    "operations.json"
)  # operations counted by benchmarks/operations.py
_NUMBERS = 256
_OPERATIONS = 16  # number of operations per array element in each sweep
_SWEEPS = 20_000


@kernel
def multiply_and_add(x, factor, addend, sweeps):  # type: ignore[no-untyped-def]
    """Apply ``factor * x + addend`` eight times in place to ``x``, ``sweeps`` times.

    Eight vectors are computed at a time, because a core has up to eight operations in progress.
    """
    n = x.size // 8
    for _ in range(sweeps):
        for i in range(n):
            a, b, c, d = x[i], x[i + n], x[i + 2 * n], x[i + 3 * n]
            e, f, g, h = x[i + 4 * n], x[i + 5 * n], x[i + 6 * n], x[i + 7 * n]
            for _ in range(8):
                a, b, c = a * factor + addend, b * factor + addend, c * factor + addend
                d, e, f = d * factor + addend, e * factor + addend, f * factor + addend
                g, h = g * factor + addend, h * factor + addend
            x[i], x[i + n], x[i + 2 * n], x[i + 3 * n] = a, b, c, d
            x[i + 4 * n], x[i + 5 * n], x[i + 6 * n], x[i + 7 * n] = e, f, g, h


def measure_peak() -> float:
    """Return the peak number of additions and multiplications per second of one core."""
    x = np.linspace(0.0, 1.0, _NUMBERS)
    multiply_and_add(x, 0.5, 0.25, 1)  # The first call compiles or loads the code.
    start = time.thread_time()
    multiply_and_add(x, 0.5, 0.25, _SWEEPS)
    return _NUMBERS * _OPERATIONS * _SWEEPS / (time.thread_time() - start)


_ALONE = 4  # number of single flights per repetition


def read_operations() -> dict[str, dict[str, float]]:
    """Return the floating-point operations per flight, by controller and kind."""
    counts: dict[str, dict[str, float]] = json.loads(OPERATIONS_FILE.read_text("utf-8"))
    return counts


def measure_speed(repetitions: int, flights: int = 64) -> dict[str, Any]:
    """Return the speed of flights as medians of `repetitions`.

    `flights` should be a multiple of the number of lanes, so that all lanes are used.
    """
    plans, parameters = make_work(flights)
    first = next(iter(plans.values()))
    for plan in plans.values():
        fly(plan, parameters[:LANES])
        fly(plan, parameters[:1], lanes=1)
    peaks: list[float] = []
    batched: dict[str, list[float]] = {name: [] for name in plans}
    alone: dict[str, list[float]] = {name: [] for name in plans}
    gains: list[float] = []
    for _ in range(repetitions):
        for name, plan in plans.items():
            peaks.append(measure_peak())
            batched[name].append(_time(plan, parameters, LANES) / flights)
            alone[name].append(_time(plan, parameters[:_ALONE], 1) / _ALONE)
        gains.append(_gain_of_two(first, parameters))
    machine, peak = find_machine(), median(peaks)
    return {
        "machine": {"cpu": machine["processor"], "cores": machine["cores"], "simd": find_simd()},
        "peak_gflops_per_core": round(peak / 1e9, 2),
        "controllers": {
            name: compare_speeds(median(batched[name]), median(alone[name]), peak, counts)
            for name, counts in read_operations().items()
        },
        "two_workers_over_one": round(median(gains), 3),
        "step_s": first.timing.step,
        "control_rate_hz": round(1.0 / first.timing.tick, 6),
        "flights": flights * repetitions,
    }


def compare_speeds(
    seconds: float, alone: float, peak: float, operations: dict[str, float]
) -> dict[str, float]:
    """Return the speed of batched and single flights relative to the peak."""
    flops = sum(operations.values())
    return {
        "flights_per_second_per_core": round(1.0 / seconds, 1),
        "ms_per_flight": round(1e3 * seconds, 4),
        "one_at_a_time_ms": round(1e3 * alone, 4),
        "batched_over_one": round(alone / seconds, 3),
        "flops_per_flight": round(flops),
        "times_the_floor": round(seconds * peak / flops, 3),
    }


def make_work(flights: int) -> tuple[dict[str, FlightPlan], Floats]:
    """Return the plans of `harder_vehicle` and the parameters of the first flights."""
    campaign = read_campaign(shipped_campaigns() / "harder_vehicle.yaml")
    model = campaign.model
    plans = {
        name: prepare(model.vehicle, model.mission, model.controllers[name], name)
        for name in CONTROLLERS
    }
    samples = campaign.make_samples()
    return plans, campaign.rows(samples.draw(0, flights))


def _time(plan: FlightPlan, parameters: Floats, lanes: int) -> float:
    start = time.thread_time()
    fly(plan, parameters, lanes=lanes)
    return time.thread_time() - start


def _gain_of_two(plan: FlightPlan, parameters: Floats) -> float:
    """Return the flights per second on two threads, divided by those on one thread."""
    with ThreadPoolExecutor(2) as pool:
        start = time.perf_counter()
        pool.submit(fly, plan, parameters).result()
        single = time.perf_counter() - start
        start = time.perf_counter()
        for flown in [pool.submit(fly, plan, parameters) for _ in range(2)]:
            flown.result()
        double = time.perf_counter() - start
    return 2.0 * single / double


def find_simd() -> str:
    """Return the widest vector instructions that the processor and the compiler support."""
    from llvmlite import binding

    features = binding.get_host_cpu_features()
    instruction_sets = {
        "avx512f": "AVX-512",
        "avx2": "AVX2",
        "avx": "AVX",
        "sse2": "SSE2",
        "sve": "SVE",
        "neon": "NEON",
    }
    return next(
        (name for feature, name in instruction_sets.items() if features.get(feature)), "none"
    )


def measure_start(repetitions: int) -> dict[str, float]:
    """Return start-up times and the memory use of the default campaign.

    Raise subprocess.CalledProcessError if a process fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        fresh = {"XDG_CACHE_HOME": str(Path(folder) / "cache")}
        cold, _ = _run(_FIRST_FLIGHT, fresh)
        warm = [_run(_FIRST_FLIGHT, fresh)[0] for _ in range(repetitions)]
        imports = [float(_run(_IMPORT, {})[1]) for _ in range(repetitions)]
        campaign = [
            str(shipped_campaigns() / "s_manoeuvre.yaml"),
            "-o",
            str(Path(folder) / "campaign"),
        ]
        memory = _peak_memory(["-m", "abhv_mc", "run", *campaign])
    return {
        "cold_start_s": round(cold, 2),
        "warm_start_s": round(median(warm), 3),
        "import_s": round(median(imports), 4),
        "peak_memory_mb": round(memory, 1),
    }


_FIRST_FLIGHT = ["-m", "abhv_mc", "fly", "s_manoeuvre", "--controllers", "tlc"]
_IMPORT = [
    "-c",
    "import time; t = time.perf_counter(); import abhv_mc; print(time.perf_counter() - t)",
]


def _run(arguments: list[str], changes: dict[str, str]) -> tuple[float, str]:
    """Run a Python process and return its wall time (s) and standard output."""
    searched = {
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        "PYTHONSAFEPATH": "1",
    }  # prevents imports from the working directory
    environment = {**os.environ, **searched, **changes}
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, check=True
    )
    return time.perf_counter() - start, done.stdout


# Linux attributes the parent's memory to a child until exec(), so a small parent is used.
_WATCH = (
    "import resource, subprocess, sys\n"
    "code = subprocess.run(sys.argv[1:], "
    "stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode\n"
    "print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
)


def _peak_memory(arguments: list[str]) -> float:
    """Return the peak resident memory (MB) of a Python process; exit code 1 is allowed."""
    _, report = _run(["-S", "-c", _WATCH, sys.executable, *arguments], {})
    code, size = map(int, report.split())
    if code not in (0, 1):
        raise subprocess.CalledProcessError(code, arguments)
    return size / (1e6 if sys.platform == "darwin" else 1e3)
