"""Command of `make bench`: python -m benchmarks.bench [--json FILE]."""

import os
import sys
from typing import Annotated, Any

import typer

from abhv_mc.cli.options import Json
from abhv_mc.cli.printing import announce_compiling, say, show_result


def bench(
    json: Json = None,
    repetitions: Annotated[
        int, typer.Option(min=1, help="Measurements of each quantity; the medians are shown.")
    ] = 9,
) -> None:
    """Measure flights per second and core, start-up times and memory use.

    The benchmark uses the default campaign and takes one or two minutes.
    """
    from benchmarks.speed import measure_speed, measure_start, read_operations

    announce_compiling()
    say("flying", file=sys.stderr, flush=True)
    figures = measure_speed(repetitions)
    say("measuring cold starts and running the default campaign", file=sys.stderr, flush=True)
    figures |= measure_start(min(repetitions, 5))
    operations = read_operations()
    show_result(figures, json, lambda: _print_figures(figures, operations))


def _print_figures(figures: dict[str, Any], operations: dict[str, dict[str, float]]) -> None:
    machine = figures["machine"]
    peak = figures["peak_gflops_per_core"]
    say(f"{machine['cpu']}, {machine['cores']} cores, {machine['simd']}")
    say(
        f"{peak:.1f} GFLOP/s peak of one core (separate additions and multiplications in registers)"
    )
    say(
        f"steps of {1e3 * figures['step_s']:g} ms (RK4), control at {figures['control_rate_hz']:g} "
        "Hz"
    )
    for name, speed in figures["controllers"].items():
        counts = ", ".join(
            f"{n / 1e6:.2f} M {kind.replace('_', ' ')}" for kind, n in operations[name].items()
        )
        rate, floor = speed["flights_per_second_per_core"], speed["flops_per_flight"] / 1e6
        say(f"\n{name}")
        say(f"  {rate:.0f} flights per second and core, {speed['ms_per_flight']:.2f} ms each")
        say(
            f"  {speed['one_at_a_time_ms']:.2f} ms one at a time, batches are "
            f"{speed['batched_over_one']:.2f} times as fast"
        )
        say(
            f"  {speed['times_the_floor']:.2f} times the minimum for {floor:.1f} M operations: "
            f"{counts}"
        )
    say(
        f"\ntwo workers simulate {figures['two_workers_over_one']:.2f} times as many flights as one"
    )
    say(
        f"time to the first flight {figures['cold_start_s']:.1f} s without the cache, "
        f"{figures['warm_start_s']:.2f} s with it"
    )
    say(f"import abhv_mc {1e3 * figures['import_s']:.0f} ms")
    say(f"memory for the default campaign with report: {figures['peak_memory_mb']:.0f} MB")


if __name__ == "__main__":
    # The number of threads must be set before numpy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    typer.run(bench)
