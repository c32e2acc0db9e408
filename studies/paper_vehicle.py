"""Search for an ensemble of vehicles that reproduce the figures of the paper's S.

    OPENBLAS_NUM_THREADS=1 python studies/paper_vehicle.py [--searches N] [--fresh] [--state DIR]
        [--minutes N]

Zhu and Shen (2014) print neither their tables nor the formula of their S manoeuvre. The searches
look for vehicles of the class (paper_vehicle_box.py, paper_vehicle_sides.py) with which Table 1 and
the printed LQR weights reproduce Figures 3 to 11 (paper_vehicle_flights.py). All candidates of a
search that may be members are stored. The ensemble is the largest set of these that includes the
vehicle `seed-2` and in which any two differ in three traits. Each search (paper_vehicle_search.py)
aims at a vehicle that would enlarge the set. The limits of searches and members differ:

- Searches count ends within 2 % of an axis and have the limits of the class (SIDES), but not those
  of the box (ENVELOPE). The free numbers leave GHAME's nodes and specific impulse, and thrust
  without inclination, so that every candidate breaks `kink`, `impulse_rise` and `inclination`.
- The members that the page accepts are selected from these vehicles and abhv, which is from another
  search, by strict counts, both insets of Figure 7, SIDES and ENVELOPE (`select_members`); the
  command prints them.

About sixty such searches ran without limits on damping. The results of eight, whose vehicles form
the largest set, are stored (paper_vehicle_starts.json). The figures do not determine pitch damping
and hardly yaw damping, so rules apply these limits to each result (`limit_damping`), and add
variants with less pitch damping (`with_damping`). Without options, the command selects the ensemble
from these and writes it to paper_vehicle.json. `--searches` adds more searches. `--fresh` starts
with only `seed-2`, searches from random starts and writes to DIR. Then each figure in
turn is left out and predicted, from three random starts. The results are written after each step.
After an interruption the same command resumes from DIR, which must be emptied if the box or the
sides change. More threads do not help with Riccati equations of 4 x 4. `--smoke` simulates one
candidate.
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, Floats
from numpy.typing import NDArray
from paper_vehicle_box import first_mean
from paper_vehicle_envelope import ENVELOPE
from paper_vehicle_flights import (
    TRAITS,
    Seen,
    fly_candidate,
    in_insets,
    strict_ends,
    third_trait,
)
from paper_vehicle_search import DIFFERENT, Found, Outcome, Search, limit_damping, rank, run
from paper_vehicle_sides import SIDES

STARTS = ROOT / "studies/paper_vehicle_starts.json"  # results of eight earlier searches
STORED = ROOT / "studies/paper_vehicle.json"
JUDGED = ROOT / "studies/paper_vehicle_claim.json"  # assessments by paper.py
FIRST = "seed-2"  # vehicle that every ensemble contains
STRICT = 19  # least number of the 20 ends of a member in their intervals, without tolerance
FIGURES = (4, 5, 6, 7, 8, 9, 10, 11)
LEFT_OUT_SEEDS = (2, 3, 4)
ALIKE = 0.02  # logarithmic difference of all traits up to which vehicles count as equal
RANDOM_STARTS = 4  # number of fresh searches that do not avoid the members
DAMPING = -0.4027  # 1/s, pitch damping of `seed-2`
LEVELS = (1.02 * DIFFERENT) ** np.arange(1.0, 4.0)  # of pitch damping
AIMED = 6  # number of traits with an aim; the figures determine the other two
_AIMS, _TRIES = 300, 6  # aims drawn for a search, and sets tried for each
_MOVED = 0.25  # standard deviation of an aim from a known vehicle, logarithmic
_BEYOND = 0.12  # largest distance of an aim outside the known vehicles, logarithmic
_CHANGE = 0.01  # added to the rank for each level of pitch damping
_VARIED = 3  # number of a search's candidates whose pitch damping is varied


def select_members(judged: dict[str, dict[str, Any]]) -> list[str]:
    """Return the assessed vehicles that match the figures strictly and keep all limits.

    Of the ends of the printed axes, STRICT are in their intervals without tolerance, and the bank
    is in both insets of Figure 7.
    """
    return [
        name
        for name, result in judged.items()
        if strict_ends(result["ends"]) >= STRICT
        and in_insets(result["ends"])
        and not any(broken_limits(result))
    ]


def broken_limits(result: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Return the limits of the class, and of the box, that an assessed vehicle breaks."""
    of_class, of_box = (
        [name for name, side in sides.items() if side.excess(result["traits"][kind][name], 0.0)]
        for kind, sides in (("class", SIDES), ("box", ENVELOPE))
    )
    return of_class, of_box


def read_starts() -> dict[str, Found]:
    """Return the vehicles of the stored searches that satisfy the rules of members.

    The searches ran without the limits of damping, so that these are applied here.
    """
    vehicles = {}
    for name, values in json.loads(STARTS.read_text(encoding="utf-8")).items():
        vehicle = limit_damping(values, fly_candidate(values).class_traits)
        vehicles |= with_damping({name: evaluate(vehicle)})
    return vehicles


def evaluate(values: dict[str, float]) -> Found:
    """Return a vehicle with its rank and traits."""
    candidate = fly_candidate(values)
    return Found(rank(candidate), values, candidate.traits)


def with_damping(vehicles: dict[str, Found]) -> dict[str, Found]:
    """Return the vehicles, and variants with less pitch damping, that may be members.

    The figures do not determine pitch damping. That of variants is below DAMPING in the ratios of
    LEVELS. Each level adds to the rank, so that members are changed only where they would else be
    too similar.
    """
    variants = dict(vehicles)
    for name, vehicle in vehicles.items():
        damping = dict(zip(TRAITS, vehicle.traits, strict=True))["rates"]
        for level, ratio in enumerate(LEVELS, 1):
            factor = DAMPING / (ratio * damping)
            if factor < 1.0:
                reduced = float(f"{factor * vehicle.values['pitch_pitch_rate']:.6g}")
                variant = evaluate(vehicle.values | {"pitch_pitch_rate": reduced})
                variants[f"{name} {level}"] = replace(variant, rank=variant.rank + _CHANGE * level)
    return {name: vehicle for name, vehicle in variants.items() if np.isfinite(vehicle.rank)}


def other_damping(traits: tuple[float, ...]) -> tuple[float, ...]:
    """Return traits with a pitch damping that differs from that of all vehicles."""
    damping = dict(zip(TRAITS, traits, strict=True))
    return tuple((damping | {"rates": 100.0 * damping["rates"]}).values())


def thin(vehicles: dict[str, Found]) -> dict[str, Found]:
    """Return `seed-2` and, best first, vehicles that differ from all previous ones."""
    distinct: dict[str, Found] = {}
    for name in sorted(vehicles, key=lambda name: (name != FIRST, vehicles[name].rank)):
        traits = np.array([vehicle.traits for vehicle in distinct.values()])
        off = (
            np.abs(np.log(np.abs(vehicles[name].traits) / np.abs(traits)))
            if distinct
            else np.ones(1)
        )
        if off.max(axis=-1).min() > ALIKE:
            distinct[name] = vehicles[name]
    return distinct


def differ(traits: Floats, other_traits: Floats) -> NDArray[np.bool_]:
    """Return whether vehicles [..., trait] differ enough for members."""
    return np.asarray(third_trait(traits, other_traits) >= np.log(DIFFERENT))


def largest_set(
    is_different: NDArray[np.bool_],
    allowed: NDArray[np.bool_],
    ranks: Floats,
    generator: np.random.Generator,
    tries: int,
) -> list[int]:
    """Return the largest set of vehicles, any two of them different, that a greedy choice finds.

    Of sets of the same size the one with the best ranks is returned.
    """
    best: list[int] = []
    for _ in range(tries):
        free, chosen = allowed.copy(), []
        while free.any():
            live = np.flatnonzero(free)
            merit = is_different[np.ix_(live, live)].sum(axis=1)
            merit = merit + generator.uniform(0.0, 3.0 + 0.15 * live.size, live.size)
            chosen.append(int(live[np.argmax(merit)]))
            free &= is_different[chosen[-1]]
        if (-len(chosen), ranks[chosen].sum()) < (-len(best), ranks[best].sum()):
            best = chosen
    return best


def choose_members(vehicles: dict[str, Found], seed: int = 0) -> dict[str, Found]:
    """Return `seed-2` and the largest set of vehicles that differ from it."""
    distinct = thin(vehicles)
    names = list(distinct)
    traits = np.array([vehicle.traits for vehicle in distinct.values()])
    ranks = np.array([vehicle.rank for vehicle in distinct.values()])
    is_different = differ(traits[:, None], traits[None])
    generator = np.random.default_rng(seed)
    members = largest_set(is_different, is_different[0], ranks, generator, 2000)
    return {names[i]: distinct[names[i]] for i in (0, *sorted(members))}


def aim_search(number: int, vehicles: dict[str, Found]) -> Search:
    """Return the search of a number, which aims where a vehicle would enlarge the set most.

    The aim is near the known vehicles.
    """
    distinct = list(thin(vehicles).values())
    generator = np.random.default_rng(number)
    traits = np.array([vehicle.traits for vehicle in distinct])
    ranks = np.array([vehicle.rank for vehicle in distinct])
    sizes, signs = np.log(np.abs(traits)), np.sign(traits[0])
    low, high = sizes.min(axis=0) - _BEYOND, sizes.max(axis=0) + _BEYOND
    is_different = differ(traits[:, None], traits[None])
    best: tuple[tuple[float, float], Search] | None = None
    for _ in range(_AIMS):
        aim = sizes[generator.integers(len(distinct))].copy()
        moved = generator.uniform(size=AIMED) < 0.6
        aim[:AIMED] += generator.normal(0.0, _MOVED, AIMED) * moved
        aim = np.clip(aim, low, high)
        apart_from_aim = differ(traits, signs * np.exp(aim))
        if not apart_from_aim[0]:
            continue
        members = largest_set(
            is_different, is_different[0] & apart_from_aim, ranks, generator, _TRIES
        )
        off = np.linalg.norm((sizes - aim)[:, :AIMED], axis=1)
        start = distinct[int(np.argmin(off))]
        merit = (-float(len(members)), float(off.min()))
        if best is None or merit < best[0]:
            drawn_away = tuple(distinct[i].traits for i in (0, *members))
            search = Search(
                f"search-{number}",
                number,
                start=start.values,
                aim=tuple(np.exp(aim[:AIMED])),
                members=drawn_away,
            )
            best = merit, search
    if best is None:
        raise SystemExit("no aim differs from `seed-2`")
    return best[1]


def run_and_tell(search: Search, folder: Path, go_on: Callable[[], bool]) -> Outcome:
    """Run a search and print a line on its state."""
    outcome = run(search, folder, go_on)
    best = f"{outcome.best.rank:.3f}" if outcome.best else "none"
    state = (
        f"{outcome.simulated} simulated, fewest ends out and largest miss {best}"
        f"{'' if outcome.done else ', not done'}"
    )
    print(f"{search.name}: {state}", flush=True)
    return outcome


def describe(name: str, values: dict[str, float]) -> dict[str, Any]:
    """Return the record of a member."""
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
    """Return the record of one axis."""
    return {
        "figure": seen.axis.figure,
        "axis": seen.axis.label,
        "low": round(seen.low, 4),
        "high": round(seen.high, 4),
        "mirrored": seen.mirrored,
        "misses": [round(miss, 4) for miss in seen.misses],
    }


def write(file: Path, members: list[dict[str, Any]], without: list[dict[str, Any]]) -> None:
    """Write the current ensemble to a results file."""
    result = {"ensemble": members, "without": without}
    file.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def find_members(
    folder: Path, go_on: Callable[[], bool], searches: int, fresh: bool
) -> dict[str, Found]:
    """Search, and return the members."""
    vehicles = read_starts()
    if fresh:
        vehicles = {FIRST: vehicles[FIRST]}
    for number in range(1, searches + 1):
        if fresh:
            members = choose_members(vehicles).values() if number > RANDOM_STARTS else ()
            avoided = tuple(other_damping(member.traits) for member in members)
            search = Search(f"search-{number}", number, members=avoided)
        else:
            search = aim_search(number, vehicles)
        outcome = run_and_tell(search, folder, go_on)
        found = {f"search-{number}-{i}": vehicle for i, vehicle in enumerate(outcome.candidates)}
        best = dict(list(thin(found).items())[:_VARIED])
        vehicles |= found | with_damping(best)
        print(f"{len(choose_members(vehicles))} members", flush=True)
        if not outcome.done:
            break
    return choose_members(vehicles)


def predict_figures(
    file: Path, result: dict[str, Any], folder: Path, go_on: Callable[[], bool]
) -> None:
    """Fit vehicles from random starts to all figures but one, and write their ends there.

    The stored ends of searches that are not completed are kept.
    """
    without = {(entry["start"], entry["figure"]): entry for entry in result["without"]}
    write(file, result["ensemble"], [*without.values()])
    for seed, figure in product(LEFT_OUT_SEEDS, FIGURES):
        search = Search(f"seed-{seed}-without-{figure}", seed, figure)
        outcome = run_and_tell(search, folder, go_on)
        if outcome.done and outcome.best is not None:
            seen = fly_candidate(outcome.best.values).seen
            ends = [ends_of(result) for result in seen if result.axis.figure == figure]
            without[seed, figure] = {"start": seed, "figure": figure, "ends": ends}
            write(file, result["ensemble"], [*without.values()])


def main() -> None:
    """Search until it is complete or the time is over."""
    parser = argparse.ArgumentParser(
        description="Find vehicles that show what the paper's figures show."
    )
    parser.add_argument(
        "--state",
        type=Path,
        default=ROOT / "reports/paper_vehicle",
        help="folder with the simulated candidates",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        default=float("inf"),
        help="time after which the search stops; the same command resumes",
    )
    parser.add_argument("--searches", type=int, default=0, help="more searches for members")
    parser.add_argument("--fresh", action="store_true", help="start with only `seed-2`")
    parser.add_argument(
        "--smoke", action="store_true", help="simulate and print one candidate, and write nothing"
    )
    arguments = parser.parse_args()
    if arguments.smoke:
        print(describe(1, first_mean(np.random.default_rng(1))))
        return
    arguments.state.mkdir(parents=True, exist_ok=True)
    end: float = time.monotonic() + 60.0 * arguments.minutes
    vehicles = find_members(
        arguments.state, lambda: time.monotonic() < end, arguments.searches, arguments.fresh
    )
    members = [describe(name.split()[0], vehicle.values) for name, vehicle in vehicles.items()]
    for member in members:
        print(f"{member['name']}: {member['ends_in']} ends inside, largest miss {member['worst']}")
    judged = json.loads(JUDGED.read_text(encoding="utf-8"))
    for name, vehicle_result in judged.items():
        print(f"{name}: {strict_ends(vehicle_result['ends'])} ends inside without tolerance")
    print(f"selected: {', '.join(select_members(judged))}")
    file = arguments.state / STORED.name if arguments.fresh else STORED
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    result = {"ensemble": members, "without": [] if arguments.fresh else stored["without"]}
    predict_figures(file, result, arguments.state, lambda: time.monotonic() < end)


if __name__ == "__main__":
    main()
