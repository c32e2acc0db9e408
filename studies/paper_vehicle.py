"""Vehicles on which the paper's S comes out as its figures show it: an ensemble, found from several seeds.

    OPENBLAS_NUM_THREADS=1 python studies/paper_vehicle.py [--state DIR] [--minutes N]

Zhu and Shen (2014) print neither their tables nor their S. Searched are vehicles of the class (paper_vehicle_box.py)
on which Table 1 and the printed LQR weights show what Figures 3 to 11 show (paper_vehicle_flights.py). Each seed draws
a vehicle and changes it until it does (paper_vehicle_search.py). For three members each figure in turn is then left out
from the same start and predicted. Stopped at any time, the same command goes on. It writes studies/paper_vehicle.json.
Riccati equations of 4 x 4 gain nothing from more threads.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from experiment import ROOT
from paper_vehicle_flights import TRAITS, Seen, apart, fly_candidate
from paper_vehicle_search import Outcome, Search, run

SEEDS = tuple(range(1, 25))
FIGURES = (4, 5, 6, 7, 8, 9, 10, 11)
LEFT_OUT_FOR = 3  # members


def find_members(folder: Path, go_on: Callable[[], bool]) -> tuple[list[dict[str, Any]], bool]:
    """What each seed has found by now, the better ones first, and whether all searches are done."""
    found, done = [], True
    for seed in SEEDS:
        outcome = run_and_tell(Search(seed), folder, go_on)
        done = done and outcome.done
        if outcome.values is not None:
            found.append(describe(seed, outcome.values))
    return sorted(found, key=lambda member: (-member["ends_in"], member["worst"])), done


def run_and_tell(search: Search, folder: Path, go_on: Callable[[], bool]) -> Outcome:
    """Run a search and print a line on how it stands."""
    outcome = run(search, folder, go_on)
    found = "no member" if outcome.values is None else f"a member: ends out and largest miss {outcome.rank:.3f}"
    print(f"{search.name}: {outcome.flown} flown, {found}{'' if outcome.done else ', not done'}", flush=True)
    return outcome


def describe(seed: int, values: dict[str, float]) -> dict[str, Any]:
    """A member as it is written."""
    candidate = fly_candidate(values)
    return {
        "name": f"seed-{seed}",
        "seed": seed,
        "ends_in": candidate.ends_in,
        "worst": round(candidate.worst, 4),
        "values": values,
        "traits": dict(zip(TRAITS, candidate.traits, strict=True)),
        "ends": [ends_of(each) for each in candidate.seen],
    }


def ends_of(seen: Seen) -> dict[str, Any]:
    """One axis, ours beside the paper's."""
    return {
        "figure": seen.axis.figure,
        "axis": seen.axis.words,
        "low": round(seen.low, 4),
        "high": round(seen.high, 4),
        "mirrored": seen.mirrored,
        "misses": [round(miss, 4) for miss in seen.misses],
    }


def choose(members: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those, the better ones first, of which any two differ by 1.5 or more in at least three traits."""
    chosen: list[dict[str, Any]] = []
    for member in members:
        traits = tuple(member["traits"].values())
        if all(apart(traits, tuple(other["traits"].values()))[2] >= 1.0 for other in chosen):
            chosen.append(member)
    return chosen


def leave_out(members: list[dict[str, Any]], folder: Path, go_on: Callable[[], bool]) -> list[dict[str, Any]]:
    """Each figure predicted by vehicles that were fitted to the others alone, from the member's own start."""
    predictions = []
    for member in members:
        for figure in FIGURES:
            outcome = run_and_tell(Search(member["seed"], figure), folder, go_on)
            if outcome.values is not None:
                seen = [each for each in fly_candidate(outcome.values).seen if each.axis.figure == figure]
                predictions.append({"member": member["name"], "figure": figure, "ends": [ends_of(s) for s in seen]})
    return predictions


def main() -> None:
    """Search, choose, leave out, write."""
    parser = argparse.ArgumentParser(description="Find vehicles that show what the paper's figures show.")
    parser.add_argument("--state", type=Path, default=ROOT / "reports/paper_vehicle", help="what has been flown")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop then; the same command goes on")
    arguments = parser.parse_args()
    arguments.state.mkdir(parents=True, exist_ok=True)
    end: float = time.monotonic() + 60.0 * arguments.minutes

    def go_on() -> bool:
        return time.monotonic() < end

    members, done = find_members(arguments.state, go_on)
    chosen = choose(members)
    predictions = leave_out(chosen[:LEFT_OUT_FOR], arguments.state, go_on) if done else []
    result = {"ensemble": chosen, "too_close": [m["name"] for m in members if m not in chosen], "without": predictions}
    target = ROOT / "studies/paper_vehicle.json" if done else arguments.state / "so_far.json"
    target.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(f"{len(chosen)} vehicles in {target}")


if __name__ == "__main__":
    main()
