"""How fast `abhv-mc worst` flies beside plain blocks of the very same flights.

    python benchmarks/worst_rate.py [--campaign FILE] [--metric NAME] [--flights 2000] [--workers N] [--rounds 5]
        [--json FILE]

A search waits for each batch before it knows the next, computes where to go, and stores every block; plain flying cuts
the same flights into blocks as a campaign does, and stores nothing. Both take turns on the same executor. Printed are
plain flying's time over the search's, medians over the rounds: of the clock, with worker processes as the command uses
them, and of the processor, with threads of this process. On a busy machine the clock says little: the search's workers
wait for the one that was held up.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np
from document import write_json

from abhv_mc.campaign.file.config import PROCESSES, THREADS
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.execution.blocks import choose_batch
from abhv_mc.execution.engine import make_engine
from abhv_mc.search.methods.worst import search_worst
from abhv_mc.search.search_flights import SearchFlights, SearchRequest, open_search
from abhv_mc.search.severity import Severity
from abhv_mc.search.worst import WorstSettings

ROOT = Path(__file__).resolve().parents[1]


def fly_plain(search: SearchFlights, rows: np.ndarray) -> None:
    """The flights of parameter rows [flight, parameter], in blocks that no block waits for."""
    size = choose_batch(len(rows), search.executor.workers)
    with ThreadPoolExecutor(search.executor.workers) as threads:
        starts = range(0, len(rows), size)
        list(threads.map(lambda start: search.executor.fly(search.plan, rows[start : start + size], None), starts))


def measure(arguments: argparse.Namespace, isolation: str, clock: Callable[[], float]) -> float:
    """Plain flying's time over the search's, median over the rounds."""
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        request = SearchRequest(arguments.campaign, Path(folder) / "search", None, workers=arguments.workers)
        engine = replace(make_engine(), isolation=isolation)
        settings = {"kind": "worst", **vars(WorstSettings(arguments.metric, flights=arguments.flights))}
        with open_search(request, settings, 1, engine) as search:
            search.progress = None
            space = search.space
            bounds = space.bounds(3.0)
            severity = Severity(arguments.metric, 1.0, search.plan.timing.duration)

            def evaluate(points: np.ndarray) -> np.ndarray:
                return severity.of(search.fly(space.from_box(points, bounds), common_seed=True))

            search.fly(space.draw_in_box(bounds, 0, 256), common_seed=True)  # the workers compile or load
            for seed in range(arguments.rounds):
                start = clock()
                found = search_worst(evaluate, len(space.names), arguments.flights, seed)
                searched = clock() - start
                values = space.complete(space.from_box(found.points, bounds), search.seed, None)
                rows = full_rows(space.columns, values)
                start = clock()
                fly_plain(search, rows)
                ratios.append((clock() - start) / searched)
                print(f"{isolation}, seed {seed}: {len(rows)} flights, {ratios[-1]:.2f}", flush=True)
    return median(ratios)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaign", type=Path, default=ROOT / "campaigns/s_manoeuvre.yaml")
    parser.add_argument("--metric", default="altitude_error_max_m")
    parser.add_argument("--flights", type=int, default=2000)
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=Path, default=None)
    arguments = parser.parse_args()
    result = {
        "campaign": arguments.campaign.stem,
        "flights": arguments.flights,
        "workers": arguments.workers,
        "by_the_clock": measure(arguments, PROCESSES, time.monotonic),
        "by_the_processor": measure(arguments, THREADS, time.process_time),
    }
    print(json.dumps(result))
    if arguments.json:
        write_json(arguments.json, result)


if __name__ == "__main__":
    main()
