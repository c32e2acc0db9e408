"""All figures of a benchmark as one record, in the fields that others read."""

from typing import Any

from abhv_mc.bench.speed import Speed
from abhv_mc.bench.start_times import Start
from abhv_mc.identity import find_machine


def make_figures(speed: Speed, start: Start) -> dict[str, Any]:
    """The record that ``abhv-mc bench --json`` writes."""
    machine = find_machine()
    timing = speed.plan.timing
    return {
        "machine": {"cpu": machine["processor"], "cores": machine["cores"], "simd": find_simd()},
        "peak_gflops_per_core": round(speed.peak / 1e9, 2),
        "controllers": {
            name: {
                "flights_per_second_per_core": round(1.0 / one.seconds, 1),
                "ms_per_flight": round(1e3 * one.seconds, 4),
                "one_at_a_time_ms": round(1e3 * one.alone_seconds, 4),
                "batched_over_one": round(one.alone_seconds / one.seconds, 3),
                "flops_per_flight": round(one.operations.total),
                "times_the_floor": round(one.times_the_floor(speed.peak), 3),
            }
            for name, one in speed.controllers.items()
        },
        "two_workers_over_one": round(speed.two_workers_over_one, 3),
        "cold_start_s": round(start.cold, 2),
        "warm_start_s": round(start.warm, 3),
        "import_s": round(start.importing, 4),
        "peak_memory_mb": round(start.peak_memory, 1),
        "step_s": timing.step,
        "control_rate_hz": round(1.0 / timing.tick, 6),
        "flights": speed.flights,
    }


def find_simd() -> str:
    """The widest vector instructions of this processor that the compiler knows."""
    from llvmlite import binding

    features = binding.get_host_cpu_features()
    known = {"avx512f": "AVX-512", "avx2": "AVX2", "avx": "AVX", "sse2": "SSE2", "sve": "SVE", "neon": "NEON"}
    return next((name for feature, name in known.items() if features.get(feature)), "none")
