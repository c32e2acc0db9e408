"""How a campaign's cost, memory and disk grow with its flights: each size in a process of its own.

    python benchmarks/campaign_growth.py [--cheap] [--controllers tlc] 1000 10000 100000

``--cheap`` puts an almost free flight of the same shape in the place of the compiled one, so that what is left is the
campaign engine itself: drawing, counting, envelopes, Parquet.
"""

import argparse
import json
import multiprocessing
import resource
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

CAMPAIGN = Path(__file__).parents[1] / "campaigns/s_manoeuvre.yaml"


def make_cheap_fly(plan):
    """A flight that is a copy of the nominal one, shifted by its parameters."""
    from abhv_mc.flight.fly import fly, nominal_parameters
    from abhv_mc.flight.plan import FlightBlock

    nominal = {every: fly(plan, nominal_parameters(), every) for every in (10, 20)}

    def cheap(_, parameters, every=None):
        block = nominal[every or 20]
        factor = parameters.prod(axis=1, where=parameters != 0.0, keepdims=True)
        shift = factor[:, 0].astype(np.float32)
        history = np.zeros((len(shift), 0, 27), np.float32) if every is None else shift[:, None, None] * block.history
        metrics = factor * block.metrics
        outcome = np.zeros(len(shift), np.int64)
        return FlightBlock(outcome, np.full(len(shift), block.end_time[0]), metrics, history, block.times)

    return cheap


def measure(flights, controllers, cheap):
    """Fly one campaign and give its figures."""
    from abhv_mc.campaign.batches import fly_block  # noqa: F401  # imports belong to the start, not to the campaign
    from abhv_mc.campaign.runner import run_campaign
    from abhv_mc.campaign.setup import Engine, Request, make_engine

    engine = make_engine()
    if cheap:
        vehicle = CAMPAIGN.parents[1] / "configs"
        plan = engine.prepare(
            vehicle / "vehicle/ghame_x.yaml", vehicle / "mission/s_manoeuvre.yaml", vehicle / "control/tlc.yaml", "tlc"
        )
        engine = Engine(engine.prepare, make_cheap_fly(plan), engine.source)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        run_campaign(Request(CAMPAIGN, out, 64, controllers=controllers), engine)  # compiles and imports
        shutil.rmtree(out)
        start = time.perf_counter()
        result = run_campaign(Request(CAMPAIGN, out, flights, controllers=controllers), engine)
        seconds = time.perf_counter() - start
        disk = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
        states = sum(path.stat().st_size for path in (out / "envelope_states").rglob("*") if path.is_file())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return {
        "flights": flights,
        "controllers": len(result.manifest["controllers"]),
        "seconds": round(seconds, 2),
        "flights_per_second": round(flights * len(result.manifest["controllers"]) / seconds),
        "peak_memory_mb": round(peak),
        "disk_mb": round(disk / 1e6, 1),
        "of_it_envelope_states_mb": round(states / 1e6, 1),
        "digest": result.manifest["digest"][:12],
    }


def main():
    """Measure every size and print one JSON line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("flights", nargs="+", type=int)
    parser.add_argument("--cheap", action="store_true")
    parser.add_argument("--controllers", default="tlc,lqr")
    options = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    for flights in options.flights:
        names = tuple(options.controllers.split(","))
        with context.Pool(1) as pool:
            print(json.dumps(pool.apply(measure, (flights, names, options.cheap))), flush=True)


if __name__ == "__main__":
    main()
