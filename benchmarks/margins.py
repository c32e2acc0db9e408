"""Time of 10,000 linearizations with their stability margins.

    python benchmarks/margins.py [--flights N] [--cores C]

Dispersed flights of ghame_x on the level mission are analysed at their trims, with 200 frequencies,
all four loops and the structured singular value of all inputs. Parallel processes load the compiled
code before the time is measured.
"""

import argparse
import json
import multiprocessing
import os
import time

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"  # the processes run in parallel, and the matrices are small

import numpy as np  # noqa: E402

SPREADS = {
    "atmosphere.density": 0.1,
    "aero.lift": 0.1,
    "aero.drag": 0.15,
    "aero.pitching_moment": 0.1,
    "mass.inertia_yy": 0.1,
}


def _prepare(controller):
    from abhv_mc.shipped import find_input, shipped_configs
    from abhv_mc_vehicle.control.controller_file import read_controller
    from abhv_mc_vehicle.control.mission import read_mission
    from abhv_mc_vehicle.stability.steady import make_steady_plan
    from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

    configs = shipped_configs()
    law = read_controller(find_input(controller, "control"))
    mission = read_mission(configs / "mission" / "level.yaml")
    return make_steady_plan(
        load_vehicle(configs / "vehicle" / "ghame_x.yaml"), mission, law, controller
    )


def _work(controller, flights, seed, ready, go, results):
    from abhv_mc_vehicle.flight.fly import nominal_parameters
    from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
    from abhv_mc_vehicle.stability.analysis import margins_of_flights

    plan = _prepare(controller)
    parameters = nominal_parameters(flights)
    draws = np.random.default_rng(seed)
    for name, half_width in SPREADS.items():
        parameters[:, PARAMETER_INDEX[name]] = draws.uniform(
            1.0 - half_width, 1.0 + half_width, flights
        )
    margins_of_flights(plan, plan, parameters[:2], ["trim"])
    ready.release()
    go.wait()
    start = time.process_time()
    margins = margins_of_flights(plan, plan, parameters, ["trim"])
    results.put(
        {
            "flights": flights,
            "processor_seconds": time.process_time() - start,
            "without_margins": sum(map(bool, margins.faults[0])),
            "gain_margin_median_db": float(np.median(margins.table[:, 0])),
            "disk_margin_median": float(np.median(margins.table[:, 3])),
        }
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=10_000)
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--controller", default="tlc")
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    options = parser.parse_args()
    if options.smoke:
        options.flights, options.cores = 2, 1
    context = multiprocessing.get_context("spawn")
    ready, go, results = context.Semaphore(0), context.Event(), context.Queue()
    share = options.flights // options.cores
    workers = [
        context.Process(target=_work, args=(options.controller, share, i, ready, go, results))
        for i in range(options.cores)
    ]
    for worker in workers:
        worker.start()
    for _ in workers:
        ready.acquire()
    start = time.perf_counter()
    go.set()
    shares = [results.get() for _ in workers]
    seconds = time.perf_counter() - start
    for worker in workers:
        worker.join()
    print(
        json.dumps(
            {
                "seconds": seconds,
                "cores": options.cores,
                "controller": options.controller,
                "parts": shares,
            }
        )
    )


if __name__ == "__main__":
    main()
