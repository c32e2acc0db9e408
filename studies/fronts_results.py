"""Flies what ``fronts.py`` found on fresh seeds: writes studies/fronts/results.json and the pairs of equal usage.

    OPENBLAS_NUM_THREADS=1 python studies/fronts_results.py [--work DIR] [--recount]

From each search the best design within each of ``GRID``'s budgets that keeps every limit: margins also at the corners
of the paper's box, and no flight lost or cycling at the 128 corners of the wide box and in ``WIDE`` fresh ones.
Errors and usage are medians over 400 fresh flights of the paper's box with their exact 95 % intervals. Then the pairs
of a TLC and an LQR, of all searches, whose six usages agree: within each budget the pair of the smallest errors.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ERRORS, ROOT, USAGE, Floats, columns, random_parameters
from fronts import (
    AGREE,
    AIMED,
    ANGLES,
    BUDGETS,
    LAWS,
    MATCHED,
    PATHS,
    SEARCHES,
    VEHICLES,
    Archive,
    Trials,
    Tried,
    mismatch,
    nearest_pair,
    retuned,
)
from robust_flights import CORNER, NOMINAL, Flown, random_flights, search_flights

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.control.controller_file import Controller, read_controller
from abhv_mc.flight.fly import fly
from abhv_mc.flight.prepare import make_plan
from abhv_mc.stability.steady import make_steady_plan
from abhv_mc.statistics.estimates import Interval, quantile
from abhv_mc.statistics.paired import median_ratio
from abhv_mc.statistics.winner import decide

FOLDER = ROOT / "studies/fronts"
GRID = tuple(sorted({*BUDGETS, 0.42, 0.6, 0.85}))  # budgets of the mean usage: those searched and some between
PAPER_SEED, WIDE_SEED = 3014, 3015
FLIGHTS = 400
WIDE = {"ghame_x": 500, "ghame_x_coupled": 200, "ghame": 200}
FRESH_PATH = 2.5  # PATH holds in the searches' 16 flights, beside which Table 1's medians in 400 are as small as 0.6
TRIES = 8  # designs that are flown for a place of the front before it stays empty


@dataclass(frozen=True)
class Fresh:
    """A design on the fresh flights."""

    errors: Floats  # [flight, ERRORS], of the paper's box
    usage: Floats  # [flight, USAGE]
    margins: Floats  # (dB, deg, ms) nominal, then the least at the corners of the paper's box
    lost: int  # of the wide box's flights
    cycling: int


class Judge:
    """Flies designs of one vehicle on fresh seeds."""

    def __init__(self, vehicle: str) -> None:
        self.name = vehicle
        self.trials = {law: Trials(vehicle, law) for law in LAWS}
        self.duel = self.trials["tlc"].duel
        self.paper = random_parameters(FLIGHTS, PAPER_SEED)
        self.corners, self.wide = search_flights()[9:137], random_flights(WIDE[vehicle], WIDE_SEED)
        block = fly(self.duel.table_1_plan, self.paper)
        self.table_1 = columns(block, ERRORS), columns(block, USAGE)
        self.references = tuple(np.median(part, axis=0) for part in self.table_1)

    def fly(self, file: Path) -> Fresh:
        """A controller's file."""
        controller = read_controller(file)
        plan = make_plan(self.duel.vehicle, self.duel.mission, controller, file.stem)
        steady = make_steady_plan(self.duel.vehicle, self.duel.mission, controller, file.stem)
        margins = self.duel.margins(plan, steady)[:, :3]
        block, wide = fly(plan, self.paper), self.count(controller, file.stem)
        least = np.hstack([margins[0], margins[1:].min(axis=0)])
        return Fresh(columns(block, ERRORS), columns(block, USAGE), least, wide.lost, wide.cycling)

    def count(self, controller: Controller, name: str) -> Flown:
        """The wide box's flights, which last LONG."""
        plan = make_plan(self.duel.vehicle, self.duel.long, controller, name)
        return self.duel.fly(plan, np.vstack([self.corners, self.wide]))

    def recount(self, design: dict[str, Any], controller: Controller, name: str) -> None:
        """Count a design's lost and cycling flights again."""
        flown = self.count(controller, name)
        design |= {"lost": flown.lost, "cycling": flown.cycling}

    def keeps(self, fresh: Fresh) -> bool:
        """Whether every limit is kept."""
        path = np.median(fresh.errors, axis=0)[PATHS] / self.references[0][PATHS]
        wanted = np.array([*NOMINAL, *CORNER])
        return bool(
            not fresh.lost and not fresh.cycling and (fresh.margins >= wanted).all() and path.max() < FRESH_PATH
        )

    def scores(self, fresh: Fresh) -> tuple[Floats, Floats]:
        """Error and usage of each flight as one number."""
        errors = (fresh.errors / self.references[0])[:, ANGLES]
        return np.sqrt((errors**2).mean(axis=1)), (fresh.usage / self.references[1]).mean(axis=1)

    def told(self, fresh: Fresh) -> dict[str, Any]:
        """What the results keep of a design."""
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
        """Whether a point keeps the limits that take no fresh flights, before it flies those."""
        plan, steady = self.trials[law].duel.plans(self.trials[law].controller(point))
        corners = self.duel.fly(plan, self.corners)
        if corners.lost or corners.cycling:
            return False
        margins = self.duel.margins(plan, steady)[:, :3]
        return bool((margins[0] >= NOMINAL).all() and (margins[1:] >= CORNER).all())

    def design(self, law: str, point: Floats, into: Path | None = None, comment: str = "") -> Fresh:
        """Fly a point of a search; its file is kept where asked for."""
        file = into or FOLDER / f"design_{self.name}.yaml"
        self.trials[law].numbers.write(file, point, comment)
        try:
            return self.fly(file)
        finally:
            if into is None:
                file.unlink()


def rounded(values: Floats) -> list[float]:
    """To four digits."""
    return [float(f"{value:.4g}") for value in values]


def triple(interval: Interval) -> list[float]:
    """Value, low, high."""
    return rounded(np.array([interval.value, interval.low, interval.high]))


def front(judge: Judge, law: str, tried: Tried) -> list[dict[str, Any]]:
    """The best design that keeps every limit within each budget, by usage."""
    kept, found = tried.kept, []
    last = -1
    for budget in GRID:
        order = [int(i) for i in np.argsort(kept.score) if kept.mean_usage[i] <= budget]
        for i in order[:TRIES]:
            if i == last:
                break
            if not judge.promises(law, kept.points[i]):
                continue
            fresh = judge.design(law, kept.points[i])
            if judge.keeps(fresh):
                found.append({"budget": budget, "point": rounded(kept.points[i]), **judge.told(fresh)})
                last = i
                break
    return found


def agreeing(tlc: Tried, lqr: Tried, budget: float) -> list[tuple[float, int, int]]:
    """Pairs within a budget whose usages agree within AIMED, by the product of their errors."""
    found: list[tuple[float, int, int]] = []
    theirs = np.flatnonzero(lqr.mean_usage <= budget)
    for i in np.flatnonzero(tlc.mean_usage <= budget).tolist():
        close = theirs[mismatch(tlc.usage[i], lqr.usage[theirs]) <= AIMED - 1.0]
        found += [(float(tlc.score[i] * lqr.score[j]), i, int(j)) for j in close]
    return sorted(found)


def compare(judge: Judge, tlc: Fresh, lqr: Fresh) -> dict[str, Any]:
    """A pair: how usages agree, and who follows which angle closer."""
    never = np.zeros(FLIGHTS, bool)
    ours, theirs = tlc.errors[:, ANGLES], lqr.errors[:, ANGLES]
    decisions = [decide(a, b, never, never, 3) for a, b in zip(ours.T, theirs.T, strict=True)]
    ratios = [median_ratio(a, b) for a, b in zip(ours.T, theirs.T, strict=True)]
    total = median_ratio(judge.scores(tlc)[0], judge.scores(lqr)[0])
    medians = np.median(tlc.usage, axis=0), np.median(lqr.usage, axis=0)
    return {
        "usage_ratio": rounded(medians[0] / medians[1]),
        "mismatch": float(f"{mismatch(*medians):.4g}"),
        "angles": [triple(ratio) for ratio in ratios if ratio],
        "closer": [{"a": "TLC", "b": "LQR", "": "neither"}[decision.winner] for decision in decisions],
        "error": triple(total) if total else None,
        "tlc": judge.told(tlc),
        "lqr": judge.told(lqr),
    }


def pairs(judge: Judge, vehicle: str, tried: dict[str, Tried]) -> list[dict[str, Any]]:
    """The best agreeing pair within each budget, or else the nearest pair of all."""
    tlc, lqr = tried["tlc"].kept, tried["lqr"].kept
    found: list[dict[str, Any]] = []
    seen: dict[tuple[str, int], Fresh] = {}

    def design(law: str, row: int) -> Fresh:
        points = (tlc if law == "tlc" else lqr).points
        seen[law, row] = seen.get((law, row)) or judge.design(law, points[row])
        return seen[law, row]

    for budget in MATCHED:
        for _, i, j in agreeing(tlc, lqr, budget)[:TRIES]:
            if not (judge.promises("tlc", tlc.points[i]) and judge.promises("lqr", lqr.points[j])):
                continue
            ours, theirs = design("tlc", i), design("lqr", j)
            told = compare(judge, ours, theirs)
            if judge.keeps(ours) and judge.keeps(theirs) and told["mismatch"] <= AGREE - 1.0:
                found.append({"budget": budget, **told})
                for law, points, row in (("tlc", tlc.points, i), ("lqr", lqr.points, j)):
                    judge.design(law, points[row], FOLDER / f"{law}_{vehicle}_{budget:g}.yaml")
                break
    if not found and len(tlc.points) and len(lqr.points):
        i, j, _ = nearest_pair(tlc, lqr)
        told = compare(judge, design("tlc", i), design("lqr", j))
        found.append({"budget": None, **told})
        if told["mismatch"] <= AGREE - 1.0 and judge.keeps(design("tlc", i)) and judge.keeps(design("lqr", j)):
            for law, points, row in (("tlc", tlc.points, i), ("lqr", lqr.points, j)):
                judge.design(law, points[row], FOLDER / f"{law}_{vehicle}.yaml")
    return found


def recount(judge: Judge, vehicle: str, told: dict[str, Any]) -> None:
    """Count the lost and cycling flights of every design in the results again."""
    for name, design in told["shipped"].items():
        file = retuned(vehicle) if name == "lqr_retuned" else name
        judge.recount(design, read_controller(ROOT / f"configs/control/{file}.yaml"), name)
    for key, designs in told["fronts"].items():
        law = key.split()[0]
        for design in designs:
            judge.recount(design, judge.trials[law].controller(np.array(design["point"])), law)
    for pair in told["pairs"]:
        for law in LAWS:
            file = FOLDER / f"{law}_{vehicle}_{pair['budget']:g}.yaml" if pair["budget"] else None
            if file and file.exists():
                judge.recount(pair[law], read_controller(file), law)
    if vehicle == "ghame_x":
        told["early_design"] = count_early_design(judge)


def count_early_design(judge: Judge) -> dict[str, list[int]]:
    """Lost and cycling flights of ``campaigns/wide.yaml``'s dispersions, by controller; each lasts LONG."""
    campaign = read_campaign(ROOT / "campaigns/wide.yaml")
    samples = campaign.make_samples()
    rows, found = campaign.rows(samples.draw(0, campaign.runs)), {}
    for name in ("tlc", "lqr", "tlc_robust", "lqr_robust"):
        controller = read_controller(ROOT / f"configs/control/{name}.yaml")
        flown = judge.duel.fly(make_plan(judge.duel.vehicle, judge.duel.long, controller, name), rows)
        found[name] = [flown.lost, flown.cycling]
    return found


def main() -> None:
    """Fly what was found."""
    parser = argparse.ArgumentParser(description="Fly the designs that fronts.py found.")
    parser.add_argument("--work", type=Path, default=ROOT / "build/fronts")
    parser.add_argument("--vehicle", nargs="+", choices=VEHICLES, default=VEHICLES)
    parser.add_argument("--recount", action="store_true", help="fly the designs of the results, count what cycles")
    arguments = parser.parse_args()
    FOLDER.mkdir(exist_ok=True)
    into = FOLDER / "results.json"
    for vehicle in arguments.vehicle:
        if arguments.recount:
            results = json.loads(into.read_text(encoding="utf-8"))
            recount(Judge(vehicle), vehicle, results[vehicle])
            into.write_text(json.dumps(results) + "\n", encoding="utf-8")
            continue
        archive, judge = Archive(arguments.work, vehicle), Judge(vehicle)
        shipped = {"tlc": "tlc", "lqr": "lqr", "tlc_robust": "tlc_robust", "lqr_robust": "lqr_robust"}
        shipped["lqr_retuned"] = retuned(vehicle)
        told: dict[str, Any] = {"hours": round(archive.seconds() / 3600.0, 2), "candidates": {}, "fronts": {}}
        told["seeds"] = {
            "search": [1000 * search for search in SEARCHES],
            "paper_box": PAPER_SEED,
            "wide_box": WIDE_SEED,
        }
        told["table_1"] = {"errors": rounded(judge.references[0]), "usage": rounded(judge.references[1])}
        told["shipped"] = {
            name: judge.told(judge.fly(ROOT / f"configs/control/{file}.yaml")) for name, file in shipped.items()
        }
        both: dict[str, Tried] = {}
        for law in LAWS:
            for search in SEARCHES:
                tried = archive.tried(law, (search,))
                told["candidates"][f"{law} {search}"] = len(tried.points)
                told["fronts"][f"{law} {search}"] = front(judge, law, tried)
            both[law] = archive.tried(law, SEARCHES)
        told["pairs"] = pairs(judge, vehicle, both)
        results = json.loads(into.read_text(encoding="utf-8")) if into.exists() else {}
        results[vehicle] = told
        into.write_text(json.dumps(results) + "\n", encoding="utf-8")
        print(f"{vehicle}: {told['candidates']}, {told['hours']} h, {len(told['pairs'])} pairs", flush=True)


if __name__ == "__main__":
    main()
