"""Check that batched flights are compiled to vector code.

    python -m benchmarks.watch

The script, part of ``make test-thorough``, fails if the ratio of processor times of single and
batched flights is below 2 with AVX-512 or 1.4 with AVX2; on other machines it only prints the
ratio.
"""

import dataclasses
import sys

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.kernel.flight.interface import LANES
from benchmarks.speed import find_simd, make_work
from benchmarks.timing import measure_ratio

LIMITS = {"AVX-512": 2.0, "AVX2": 1.4}
TICKS = 400  # of each flight, which suffice for the ratio
ATTEMPTS = 3


def measure_gain(plan: FlightPlan, parameters: Floats) -> float:
    """Return the time of single flights over that of a batch, for as many flights as lanes."""
    short = dataclasses.replace(plan, timing=plan.timing._replace(ticks=TICKS))
    return measure_ratio(
        lambda: fly(short, parameters, lanes=1), lambda: fly(short, parameters, lanes=LANES)
    )


def main() -> int:
    """Return the exit code, 1 if a controller is below the limit in every attempt."""
    simd = find_simd()
    limit = LIMITS.get(simd, 0.0)
    plans, parameters = make_work(LANES)
    slow = []
    for name, plan in plans.items():
        gain = 0.0
        for _ in range(ATTEMPTS):
            gain = max(gain, measure_gain(plan, parameters))
            if gain >= limit:
                break
        requirement = f"at least {limit:g} with {simd}" if limit else f"no limit with {simd}"
        print(
            f"{name}: {LANES} flights in a batch are {gain:.2f} times as fast as one at a time "
            f"({requirement})"
        )
        slow += [name] if gain < limit else []
    if slow:
        print(
            f"too slow: {', '.join(slow)}; see the rules in abhv_mc_vehicle/kernel/jit.py",
            file=sys.stderr,
        )
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(main())
