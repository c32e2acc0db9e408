"""Validation of the designs of ``fronts.py`` with new seeds; writes studies/fronts/results.json.

    OPENBLAS_NUM_THREADS=1 python studies/fronts_results.py
        [--vehicle NAME ...] [--work DIR] [--again]

From each search the best design within each of ``BUDGETS`` is selected that satisfies every limit:
margins also at the corners of the paper's box, and no early termination or oscillation at the 128
corners of the wide box and in ``WIDE`` new flights. Errors and usage are medians over 400 new
flights of the paper's box with their exact 95 % intervals. `--again` simulates the stored designs
instead, for example after a change of a vehicle, and keeps those that satisfy every limit. For
`abhv`, only the shipped controllers are simulated.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ERRORS, ROOT, USAGE, Floats, columns, random_parameters
from fronts import ANGLES, BUDGETS, DEFAULT, LAWS, PATHS, SEARCHES, VEHICLES, Archive, Trials, Tried
from robust_flights import CORNER, NOMINAL, Flown, random_flights, search_flights

from abhv_mc.shipped import find_input
from abhv_mc.statistics.estimates import Interval, quantile
from abhv_mc_vehicle.control.controller_file import Controller, read_controller
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.flight.prepare import make_plan
from abhv_mc_vehicle.stability.steady import make_steady_plan

PAPER_SEED, WIDE_SEED = 3014, 3015
FLIGHTS, WIDE = 400, 200
FRESH_PATH = 2.0  # instead of PATH, which applies to the 16 flights of the searches
SHIPPED = {DEFAULT: ("tlc", "lqr", "tlc_robust_abhv", "lqr_robust_abhv")}
PRINTED = ("tlc", "lqr")  # of the other vehicles
TRIES = 8  # designs that are tried for a budget before it stays empty


@dataclass(frozen=True)
class Fresh:
    """Results of a design in the new flights."""

    errors: Floats  # [flight, ERRORS], of the paper's box
    usage: Floats  # [flight, USAGE]
    margins: Floats  # (dB, deg, ms) nominal, then the least at the corners of the paper's box
    lost: int  # early terminations in the wide box
    cycling: int


class Judge:
    """Validation of designs of one vehicle with new seeds."""

    def __init__(self, vehicle: str, flights: int = FLIGHTS) -> None:
        self.name = vehicle
        self.trials = {law: Trials(vehicle, law) for law in LAWS}
        self.duel = self.trials["tlc"].duel
        self.paper = random_parameters(flights, PAPER_SEED)
        self.corners, self.wide = (
            search_flights()[9:137],
            random_flights(min(flights, WIDE), WIDE_SEED),
        )
        block = fly(self.duel.table_1_plan, self.paper)
        self.table_1 = columns(block, ERRORS), columns(block, USAGE)
        self.references = tuple(np.median(metrics, axis=0) for metrics in self.table_1)

    def fly(self, controller: Controller, name: str) -> Fresh:
        """Run the flights of a design."""
        plan = make_plan(self.duel.vehicle, self.duel.mission, controller, name)
        steady = make_steady_plan(self.duel.vehicle, self.duel.mission, controller, name)
        margins = self.duel.margins(plan, steady)[:, :3]
        block, wide = fly(plan, self.paper), self.count(controller, name)
        least = np.hstack([margins[0], margins[1:].min(axis=0)])
        return Fresh(columns(block, ERRORS), columns(block, USAGE), least, wide.lost, wide.cycling)

    def count(self, controller: Controller, name: str) -> Flown:
        """Run the flights of the wide box, which last LONG, for which the fuel of abhv is short."""
        mission = self.duel.mission if self.name == DEFAULT else self.duel.long
        plan = make_plan(self.duel.vehicle, mission, controller, name)
        return self.duel.fly(plan, np.vstack([self.corners, self.wide]))

    def keeps(self, fresh: Fresh) -> bool:
        """Return whether every limit is satisfied."""
        path = np.median(fresh.errors, axis=0)[PATHS] / self.references[0][PATHS]
        required = np.array([*NOMINAL, *CORNER])
        return bool(
            not fresh.lost
            and not fresh.cycling
            and (fresh.margins >= required).all()
            and (path < FRESH_PATH).all()
        )

    def scores(self, fresh: Fresh) -> tuple[Floats, Floats]:
        """Return error and usage of each flight."""
        errors = (fresh.errors / self.references[0])[:, ANGLES]
        return np.sqrt((errors**2).mean(axis=1)), (fresh.usage / self.references[1]).mean(axis=1)

    def record(self, fresh: Fresh) -> dict[str, Any]:
        """Return the record of a design for the results file."""
        score, usage = self.scores(fresh)
        angles = (fresh.errors / self.references[0])[:, ANGLES].T
        return {
            "error": triple(quantile(score, 0.5)),
            "angles": [triple(quantile(angle, 0.5)) for angle in angles],
            "mean_usage": triple(quantile(usage, 0.5)),
            "usage": rounded(np.median(fresh.usage, axis=0) / self.references[1]),
            "path": rounded(np.median(fresh.errors, axis=0)[PATHS] / self.references[0][PATHS]),
            "margins": rounded(fresh.margins),
            "lost": fresh.lost,
            "cycling": fresh.cycling,
        }

    def promises(self, law: str, point: Floats) -> bool:
        """Return whether a point satisfies all limits that can be checked without new flights."""
        plan, steady = self.trials[law].duel.plans(self.trials[law].controller(point))
        corners = self.duel.fly(plan, self.corners)
        if corners.lost or corners.cycling:
            return False
        margins = self.duel.margins(plan, steady)[:, :3]
        return bool((margins[0] >= NOMINAL).all() and (margins[1:] >= CORNER).all())

    def design(self, law: str, point: Floats) -> Fresh:
        """Run the flights of a point of a search."""
        return self.fly(self.trials[law].controller(point), law)


def rounded(values: Floats) -> list[float]:
    """Return values rounded to four digits."""
    return [float(f"{value:.4g}") for value in values]


def triple(interval: Interval) -> list[float]:
    """Return value, low and high."""
    return rounded(np.array([interval.value, interval.low, interval.high]))


def front(judge: Judge, law: str, tried: Tried) -> list[dict[str, Any]]:
    """Return the best design within each budget that satisfies every limit, by usage."""
    within_limits, designs = tried.feasible, []
    last = -1
    for budget in BUDGETS[::-1]:
        order = [
            int(i) for i in np.argsort(within_limits.score) if within_limits.mean_usage[i] <= budget
        ]
        for i in order[:TRIES]:
            if i == last:
                break
            if not judge.promises(law, within_limits.points[i]):
                continue
            fresh = judge.design(law, within_limits.points[i])
            if judge.keeps(fresh):
                designs.append(
                    {
                        "budget": budget,
                        "point": rounded(within_limits.points[i]),
                        **judge.record(fresh),
                    }
                )
                last = i
                break
    return designs


def front_again(judge: Judge, law: str, designs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the stored designs of a search that still satisfy every limit, simulated again."""
    flown = [(design, judge.design(law, np.array(design["point"]))) for design in designs]
    return [
        {"budget": design["budget"], "point": design["point"], **judge.record(fresh)}
        for design, fresh in flown
        if judge.keeps(fresh)
    ]


def main() -> None:
    """Validate the designs and write the results."""
    parser = argparse.ArgumentParser(description="Fly the designs that fronts.py found.")
    parser.add_argument("--work", type=Path, default=ROOT / "build/fronts")
    vehicles = (*VEHICLES, DEFAULT)
    parser.add_argument("--vehicle", nargs="+", choices=vehicles, default=vehicles)
    parser.add_argument("--again", action="store_true", help="only the stored designs")
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    if arguments.smoke:
        judge = Judge(VEHICLES[0], 2)
        print(judge.record(judge.fly(read_controller(ROOT / "configs/control/lqr.yaml"), "lqr")))
        return
    into = ROOT / "studies/fronts/results.json"
    for vehicle in arguments.vehicle:
        archive, judge = Archive(arguments.work, vehicle), Judge(vehicle)
        results = json.loads(into.read_text(encoding="utf-8")) if into.exists() else {}
        record: dict[str, Any] = {
            "hours": round(archive.seconds() / 3600.0, 2),
            "candidates": {},
            "fronts": {},
        }
        if arguments.again and vehicle != DEFAULT:
            stored = results[vehicle]
            record |= {name: stored[name] for name in ("hours", "candidates")}
            record["fronts"] = {
                search: front_again(judge, search.split()[0], designs)
                for search, designs in stored["fronts"].items()
            }
        record["table_1"] = {
            "errors": rounded(judge.references[0]),
            "usage": rounded(judge.references[1]),
        }
        record["shipped"] = {
            name: judge.record(judge.fly(read_controller(find_input(name, "control")), name))
            for name in SHIPPED.get(vehicle, PRINTED)
        }
        for law in () if arguments.again or vehicle == DEFAULT else LAWS:
            for search in SEARCHES:
                tried = archive.tried(law, (search,))
                record["candidates"][f"{law} {search}"] = len(tried.points)
                record["fronts"][f"{law} {search}"] = front(judge, law, tried)
        results[vehicle] = record
        into.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        print(f"{vehicle}: {record['candidates']}, {record['hours']} h", flush=True)


if __name__ == "__main__":
    main()
