"""Vehicles on which the paper's S comes out as its figures show it: an ensemble.

    OPENBLAS_NUM_THREADS=1 python studies/paper_vehicle.py [--searches N] [--fresh] [--state DIR] [--minutes N]

Zhu and Shen (2014) print neither their tables nor their S. Searched are vehicles of the class (paper_vehicle_box.py,
paper_vehicle_sides.py) on which Table 1 and the printed LQR weights show what Figures 3 to 11 show
(paper_vehicle_flights.py). Everything on the way of a search that may be a member is kept. The ensemble is the largest
set found of these, the shipped vehicle among them, of which any two differ in three traits. Each search
(paper_vehicle_search.py) aims where a vehicle would enlarge it. Stored are the vehicles that such searches, some fifty
in all, have found; `--searches` adds more, `--fresh` begins with the shipped vehicle alone. Then each figure in turn is
left out and predicted, from three random starts. studies/paper_vehicle.json is written after each step; stopped at any
time, the same command goes on from DIR, which is to be emptied when the box or the sides change. Riccati equations of
4 x 4 gain nothing from more threads. `--smoke` simulates one candidate.
"""

import argparse
import json
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, Floats
from numpy.typing import NDArray
from paper_vehicle_box import first_mean
from paper_vehicle_flights import TRAITS, Seen, fly_candidate, third_trait
from paper_vehicle_search import DIFFERENT, Found, Outcome, Search, rank, run

STARTS = ROOT / "studies/paper_vehicle_starts.json"  # what earlier searches found
SHIPPED = "seed-2"  # the vehicle abhv
FIGURES = (4, 5, 6, 7, 8, 9, 10, 11)
LEFT_OUT_SEEDS = (2, 3, 4)
ALIKE = 0.02  # of each trait, logarithmic: one of such vehicles is enough
AIMED = 6  # traits: the other two the figures fix
_AIMS, _TRIES = 300, 6  # aims drawn for a search, and sets tried for each
_MOVED = 0.25  # standard deviation of an aim from a vehicle that was found, logarithmic
_BEYOND = 0.12  # of an aim beyond all that was found


def read_starts() -> dict[str, Found]:
    """Return the stored vehicles, which stay members only while they keep the rules."""
    found = {}
    for name, values in json.loads(STARTS.read_text(encoding="utf-8")).items():
        candidate = fly_candidate(values)
        grade = rank(candidate)
        if np.isfinite(grade):
            found[name] = Found(grade, values, candidate.traits)
    return found


def thin(found: dict[str, Found]) -> dict[str, Found]:
    """Return the shipped vehicle and, best first, what is unlike all that is kept before."""
    kept: dict[str, Found] = {}
    for name in sorted(found, key=lambda name: (name != SHIPPED, found[name].rank)):
        theirs = np.array([each.traits for each in kept.values()])
        off = np.abs(np.log(np.abs(found[name].traits) / np.abs(theirs))) if kept else np.ones(1)
        if off.max(axis=-1).min() > ALIKE:
            kept[name] = found[name]
    return kept


def differ(traits: Floats, others: Floats) -> NDArray[np.bool_]:
    """Whether vehicles [..., trait] differ as members do."""
    return np.asarray(third_trait(traits, others) >= np.log(DIFFERENT))


def largest_set(
    apart: NDArray[np.bool_],
    allowed: NDArray[np.bool_],
    ranks: Floats,
    generator: np.random.Generator,
    tries: int,
) -> list[int]:
    """Return vehicles of which any two are apart: as many as are found by greedy choice, the best of these."""
    best: list[int] = []
    for _ in range(tries):
        free, chosen = allowed.copy(), []
        while free.any():
            live = np.flatnonzero(free)
            merit = apart[np.ix_(live, live)].sum(axis=1)
            merit = merit + generator.uniform(0.0, 3.0 + 0.15 * live.size, live.size)
            chosen.append(int(live[np.argmax(merit)]))
            free &= apart[chosen[-1]]
        if (-len(chosen), ranks[chosen].sum()) < (-len(best), ranks[best].sum()):
            best = chosen
    return best


def choose_members(found: dict[str, Found], seed: int = 0) -> dict[str, Found]:
    """Return the shipped vehicle and the largest set beside it."""
    kept = thin(found)
    names = list(kept)
    traits = np.array([each.traits for each in kept.values()])
    ranks = np.array([each.rank for each in kept.values()])
    apart = differ(traits[:, None], traits[None])
    generator = np.random.default_rng(seed)
    others = largest_set(apart, apart[0], ranks, generator, 2000)
    return {names[i]: kept[names[i]] for i in (0, *sorted(others))}


def aim_search(number: int, found: dict[str, Found]) -> Search:
    """Return the search of a number: to where, near what is found, a vehicle would enlarge the set most."""
    kept = list(thin(found).values())
    generator = np.random.default_rng(number)
    traits = np.array([each.traits for each in kept])
    ranks = np.array([each.rank for each in kept])
    sizes, signs = np.log(np.abs(traits)), np.sign(traits[0])
    low, high = sizes.min(axis=0) - _BEYOND, sizes.max(axis=0) + _BEYOND
    apart = differ(traits[:, None], traits[None])
    best: tuple[tuple[float, float], Search] | None = None
    for _ in range(_AIMS):
        aim = sizes[generator.integers(len(kept))].copy()
        moved = generator.uniform(size=AIMED) < 0.6
        aim[:AIMED] += generator.normal(0.0, _MOVED, AIMED) * moved
        aim = np.clip(aim, low, high)
        apart_from_aim = differ(traits, signs * np.exp(aim))
        if not apart_from_aim[0]:
            continue
        others = largest_set(apart, apart[0] & apart_from_aim, ranks, generator, _TRIES)
        off = np.linalg.norm((sizes - aim)[:, :AIMED], axis=1)
        start = kept[int(np.argmin(off))]
        merit = (-float(len(others)), float(off.min()))
        if best is None or merit < best[0]:
            drawn_away = tuple(kept[i].traits for i in (0, *others))
            search = Search(
                f"search-{number}",
                number,
                start=start.values,
                aim=tuple(np.exp(aim[:AIMED])),
                others=drawn_away,
            )
            best = merit, search
    if best is None:
        raise SystemExit("no aim differs from the shipped vehicle")
    return best[1]


def run_and_tell(search: Search, folder: Path, go_on: Callable[[], bool]) -> Outcome:
    """Run a search and print a line on how it stands."""
    outcome = run(search, folder, go_on)
    told = f"{outcome.best.rank:.3f}" if outcome.best else "none"
    words = (
        f"{outcome.flown} simulated, least ends out and largest miss {told}"
        f"{'' if outcome.done else ', not done'}"
    )
    print(f"{search.name}: {words}", flush=True)
    return outcome


def describe(name: str, values: dict[str, float]) -> dict[str, Any]:
    """A member as it is written."""
    candidate = fly_candidate(values)
    return {
        "name": name,
        "ends_in": candidate.ends_in,
        "worst": round(candidate.worst, 4),
        "values": values,
        "traits": dict(zip(TRAITS, candidate.traits, strict=True)),
        "class_traits": {name: float(f"{x:.4g}") for name, x in candidate.class_traits.items()},
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


def write(members: list[dict[str, Any]], without: list[dict[str, Any]]) -> None:
    """The ensemble so far, to the results file."""
    result = {"ensemble": members, "without": without}
    (ROOT / "studies/paper_vehicle.json").write_text(
        json.dumps(result, indent=1) + "\n", encoding="utf-8"
    )


def find_members(
    folder: Path, go_on: Callable[[], bool], searches: int, fresh: bool
) -> dict[str, Found]:
    """Search, and return the members."""
    found = read_starts()
    if fresh:
        found = {SHIPPED: found[SHIPPED]}
    for number in range(1, searches + 1):
        outcome = run_and_tell(aim_search(number, found), folder, go_on)
        found |= {f"search-{number}-{i}": each for i, each in enumerate(outcome.found)}
        print(f"{len(choose_members(found))} members", flush=True)
        if not outcome.done:
            break
    return choose_members(found)


def predict_figures(members: list[dict[str, Any]], folder: Path, go_on: Callable[[], bool]) -> None:
    """Fit vehicles from random starts to all figures but one, and write what they show there."""
    without: list[dict[str, Any]] = []
    for seed, figure in product(LEFT_OUT_SEEDS, FIGURES):
        search = Search(f"seed-{seed}-without-{figure}", seed, figure)
        outcome = run_and_tell(search, folder, go_on)
        if outcome.done and outcome.best is not None:
            seen = fly_candidate(outcome.best.values).seen
            ends = [ends_of(each) for each in seen if each.axis.figure == figure]
            without.append({"start": seed, "figure": figure, "ends": ends})
            write(members, without)


def main() -> None:
    """Search until it is done or the time is over."""
    parser = argparse.ArgumentParser(
        description="Find vehicles that show what the paper's figures show."
    )
    parser.add_argument(
        "--state", type=Path, default=ROOT / "reports/paper_vehicle", help="what has been flown"
    )
    parser.add_argument(
        "--minutes", type=float, default=float("inf"), help="stop then; the same command goes on"
    )
    parser.add_argument("--searches", type=int, default=0, help="more searches for members")
    parser.add_argument("--fresh", action="store_true", help="begin with the shipped vehicle alone")
    parser.add_argument(
        "--smoke", action="store_true", help="simulate and print one candidate, and write nothing"
    )
    arguments = parser.parse_args()
    if arguments.smoke:
        print(describe(1, first_mean(np.random.default_rng(1))))
        return
    arguments.state.mkdir(parents=True, exist_ok=True)
    end: float = time.monotonic() + 60.0 * arguments.minutes
    found = find_members(
        arguments.state, lambda: time.monotonic() < end, arguments.searches, arguments.fresh
    )
    members = [describe(name, each.values) for name, each in found.items()]
    write(members, [])
    predict_figures(members, arguments.state, lambda: time.monotonic() < end)


if __name__ == "__main__":
    main()
