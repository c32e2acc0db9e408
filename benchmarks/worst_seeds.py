"""Comparison of `abhv-mc worst` with as many random flights in the same box, for each seed.

    python -m benchmarks.worst_seeds [--campaign FILE] [--metric NAME] [--controller NAME]
        [--seeds 20] [--flights 2000] [--json FILE]

The script prints a line for each seed with the worst value of the search and of the random flights
(those that `worst` runs for its page). In the JSON file a flight that terminated early has 1e9 plus
the remaining seconds. The last line has the number of seeds in which the search is not worse than
the random flights. The exit code is 1 if the search is worse for any seed.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from abhv_mc.requests import WorstRequest
from abhv_mc.search.methods.worst import search_worst
from abhv_mc.search.search_flights import ENDED_EARLY, Severity, open_search
from abhv_mc.statistics.estimates import Criterion
from benchmarks.document import write_json

ROOT = Path(__file__).resolve().parents[1]


def shown(severity: float) -> str:
    """Return a severity as text: the metric, or the remaining time after an early termination."""
    return (
        f"{severity:.6g}"
        if severity < ENDED_EARLY
        else f"ended early ({severity - ENDED_EARLY:.4g} s left)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaign", type=Path, default=ROOT / "campaigns/harder_vehicle.yaml")
    parser.add_argument("--metric", default="altitude_error_max_m")
    parser.add_argument("--controller", default=None)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--flights", type=int, default=2000)
    parser.add_argument("--box", type=float, default=3.0)
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.seeds, arguments.flights = 1, 128
    not_below, rows = 0, []
    with tempfile.TemporaryDirectory() as folder:
        request = WorstRequest(
            arguments.campaign,
            Path(folder) / "search",
            arguments.metric,
            controller=arguments.controller,
            flights=arguments.flights,
        )
        settings = {"kind": "worst", **request.settings}
        with open_search(request, settings, 1) as search:
            search.progress = None
            space = search.space
            bounds = space.bounds(arguments.box)
            severity = Severity(Criterion(arguments.metric, "high"), search.duration)

            def evaluate(points: np.ndarray) -> np.ndarray:
                return severity.of(search.fly(space.from_box(points, bounds), common_seed=True))

            search.fly(
                space.draw_in_box(bounds, 0, 256), common_seed=True
            )  # the workers compile or load
            for seed in range(arguments.seeds):
                worst = search_worst(evaluate, len(space.names), arguments.flights, seed)
                values = space.draw_in_box(bounds, seed, arguments.flights)
                random = max(
                    float(severity.of(search.fly(values[i : i + 256], common_seed=True)).max())
                    for i in range(0, len(values), 256)
                )
                not_below += worst.value >= random
                rows.append({"seed": seed, "search": worst.value, "random": random})
                print(
                    f"seed {seed}: search {shown(worst.value)}, random {shown(random)}", flush=True
                )
    print(f"not below in {not_below} of {arguments.seeds} seeds")
    if arguments.json:
        result = {
            "campaign": arguments.campaign.stem,
            "controller": request.controller or "the first",
            "metric": arguments.metric,
            "flights": arguments.flights,
            "not_below": not_below,
            "seeds": rows,
        }
        write_json(arguments.json, result)
    sys.exit(not_below < arguments.seeds and not arguments.smoke)


if __name__ == "__main__":
    main()
