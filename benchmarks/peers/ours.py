"""Time of abhv-mc: both controllers, batched and one at a time, including metrics."""

from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.kernel.flight.interface import LANES
from benchmarks.peers.peer import measure, read_work, write_result
from benchmarks.speed import measure_peak

ALONE = 16  # flights of a repeat, one at a time


def main() -> None:
    work = read_work()
    for law, plan in work.plans.items():
        for lanes, parameters in ((LANES, work.parameters), (1, work.parameters[:ALONE])):
            fly(plan, parameters[:LANES], lanes=lanes)
            seconds = measure(
                lambda: fly(plan, parameters, lanes=lanes),  # noqa: B023
                len(parameters),
                work.repeats,
            )
            name = f"abhv-mc {law} {'batched' if lanes > 1 else 'one at a time'}"
            write_result(name, seconds, peak_gflops=measure_peak() / 1e9)


if __name__ == "__main__":
    main()
