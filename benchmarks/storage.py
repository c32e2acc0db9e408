"""Ratio of the processor time per flight of a campaign to that of the kernel alone.

    python -m benchmarks.storage [--rounds N]

TLC and LQR of the default campaign run in one thread of this process. The time per flight is the
difference of a larger and a smaller campaign over the difference of their flights, without fixed
costs; the kernel computes the same samples in alternation. Flights per second and core are given
per GFLOP/s of the core's peak.
"""

import argparse
import contextlib
import dataclasses
import io
import tempfile
import time
from pathlib import Path
from statistics import median

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.execution.runner import run_campaign
from abhv_mc.requests import Request
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.plant.parameters import OURS
from abhv_mc_vehicle.vehicle_simulator.simulator import make_engine
from benchmarks.speed import measure_peak

CAMPAIGN = Path(__file__).parents[1] / "campaigns" / "harder_vehicle.yaml"
LAWS = ("tlc", "lqr")
SIZES = {"up to 4096 flights": (1024, 4096), "beyond": (8192, 24_576)}
BATCH = 1024


def run(flights: int) -> float:
    """Return the processor time of a campaign, s."""
    engine = dataclasses.replace(make_engine(), isolation="threads", find_stability=None)
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(io.StringIO()):
        start = time.process_time()
        run_campaign(Request(CAMPAIGN, Path(folder) / "out", flights, None, LAWS, 1), engine)
        return time.process_time() - start


def main() -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    options = parser.parse_args()
    rounds, sizes = (1, {"two flights": (1, 2)}) if options.smoke else (options.rounds, SIZES)
    campaign = read_campaign(CAMPAIGN, BATCH, None, LAWS)
    samples = campaign.make_samples()
    parameters = full_rows(samples.names, samples.draw(0, BATCH), (), OURS)
    plans = campaign.simulator.make_plans(LAWS)

    def kernel() -> float:
        start = time.process_time()
        for plan in plans.values():
            fly(plan, parameters)
        return (time.process_time() - start) / (BATCH * len(LAWS))

    kernel()  # loads or compiles
    run(64)
    for label, (few, many) in sizes.items():
        ratios, rates = [], []
        for _ in range(rounds):
            before, small, between, large, after = kernel(), run(few), kernel(), run(many), kernel()
            flight = (large - small) / ((many - few) * len(LAWS))
            ratios.append(flight / median((before, between, after)))
            rates.append(1e9 / (flight * measure_peak()))
        print(
            f"{label}: {median(ratios):.3f} x the kernel ({min(ratios):.3f} to "
            f"{max(ratios):.3f}), ",
            end="",
        )
        print(
            f"{median(rates):.1f} flights/s per GFLOP/s ({min(rates):.1f} to {max(rates):.1f})",
            flush=True,
        )


if __name__ == "__main__":
    main()
