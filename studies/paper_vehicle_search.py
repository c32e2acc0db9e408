"""Search from a vehicle of the box for the nearest one whose flights match the paper's axes.

Thirty parameters are free and there are twenty ends, so that few parameters are determined, but
searches without further terms end near each other. A search may therefore have an aim and members
to avoid, which add terms to the Gauss-Newton steps in a trust region (scipy's least_squares) that
lead to the ends and sides. If no start is given, the search draws one. The simulated candidates are
stored in a file, from which the search resumes: the method evaluates the same candidates if it
receives the same results.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from experiment import Floats
from paper_vehicle_box import FREE, first_mean, limits, to_numbers, to_values
from paper_vehicle_flights import FURTHEST, READING, Candidate, fly_candidate, third_trait
from paper_vehicle_sides import HALF_LENGTH, SIDES

ENDS = 18  # required number of the 20 ends in their intervals
DIFFERENT = 1.5  # factor (or other sign) by which any two members differ in three traits
OFF_NODE = 0.1  # deg, of the trim from a node of the tables
LIMITED_RADIUS = 4.2  # m, radius of pitch damping that replaces one beyond its limit
LIMITED_SHARE = 0.99  # of yaw damping, largest share of the rudder after an increase
_DIFFERENCE = 0.03  # of the unit of the search's numbers, for slopes
_DIFFERENCED = 3  # steps after which slopes are computed by differences again
_PATIENCE = 100  # candidates, after which any that differs is accepted
_DRAWS = 50
_STAGES = (("linear", 15), ("soft_l1", 15))  # the second stage tolerates one or two large misses
_CYCLE = 0.05  # largest Candidate.cycle without oscillation
_APART, _AWAY = 1.55, 2.0  # factor up to which members repel, and the weight
_AIM, _PULL = 1.03, 0.12  # factor from which the aim attracts, and the weight


@dataclass(frozen=True)
class Search:
    """Start and aim of a search; the ends of the figure ``left_out`` do not count."""

    name: str  # of its file
    seed: int  # of its draws
    left_out: int = 0
    start: dict[str, float] | None = None
    aim: tuple[float, ...] = ()  # the first of TRAITS
    members: tuple[tuple[float, ...], ...] = ()  # traits of members to differ from

    def pulls(self, traits: tuple[float, ...]) -> list[float]:
        """Return the residuals that attract a vehicle to the aim and repel it from the members."""
        off = np.log(np.abs(np.array(traits[: len(self.aim)]) / np.array(self.aim)))
        near = (np.log(_APART) - float(third_trait(traits, member)) for member in self.members)
        return [
            *(_PULL * np.sign(off) * np.maximum(np.abs(off) - np.log(_AIM), 0.0)).tolist(),
            *(_AWAY * max(distance, 0.0) for distance in near),
        ]

    def is_different(self, traits: tuple[float, ...]) -> bool:
        """Return whether a vehicle differs from each of the members."""
        return all(third_trait(traits, member) >= np.log(DIFFERENT) for member in self.members)


@dataclass(frozen=True)
class Found:
    """Candidate that may be a member."""

    rank: float  # number of ends outside, plus the largest miss
    values: dict[str, float]
    traits: tuple[float, ...]


def limit_damping(values: dict[str, float], class_traits: dict[str, float]) -> dict[str, float]:
    """Return the values with pitch and yaw damping inside their limits.

    The figures do not determine the two. A radius of pitch damping beyond its limit is reduced to
    LIMITED_RADIUS. If the rudder alone damps yaw more than the vehicle, yaw damping is increased by
    whole percents until the share of the rudder is at most LIMITED_SHARE.
    """
    limited = dict(values)
    radius, share = class_traits["damping_radius"], class_traits["rudder_damping"]
    if radius > HALF_LENGTH:
        reduced = values["pitch_pitch_rate"] * (LIMITED_RADIUS / round(radius, 2)) ** 2
        limited["pitch_pitch_rate"] = float(f"{reduced:.6g}")
    if share > SIDES["rudder_damping"].high:
        increased = values["yaw_yaw_rate"] * (
            1.0 + np.ceil(100.0 * (share / LIMITED_SHARE - 1.0)) / 100.0
        )
        limited["yaw_yaw_rate"] = round(round(float(increased) / 0.005) * 0.005, 3)
    return limited


@dataclass
class Outcome:
    """State of a search: number of simulated candidates, and those that may be members."""

    done: bool = False
    simulated: int = 0
    candidates: list[Found] = field(default_factory=list)

    @property
    def best(self) -> Found | None:
        """Candidate with the smallest rank."""
        return min(self.candidates, key=lambda candidate: candidate.rank, default=None)


class _Stop(Exception):
    """End of a search by time or success."""


def rank(candidate: Candidate, left_out: int = 0) -> float:
    """Return the number of ends outside plus the largest miss; infinite if not a member."""
    axes = [axis_result for axis_result in candidate.seen if axis_result.axis.figure != left_out]
    if not axes or candidate.off_node < OFF_NODE or candidate.cycle > _CYCLE:
        return float("inf")
    if not candidate.keeps_sides:
        return float("inf")
    misses = [
        miss for axis_result in axes if axis_result.axis.counts for miss in axis_result.misses
    ]
    limits_kept = all(
        max(axis_result.misses) <= READING for axis_result in axes if not axis_result.axis.counts
    )
    out, worst = sum(miss > READING for miss in misses), max(misses)
    return out + worst if limits_kept and out <= 20 - ENDS and worst <= FURTHEST else float("inf")


def run(search: Search, folder: Path, go_on: Callable[[], bool]) -> Outcome:
    """Run a search until it is complete or ``go_on`` returns false.

    Each line of its file is the result of a candidate.
    """
    from scipy.optimize import least_squares

    file = folder / f"{search.name}.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    outcome = Outcome()
    has_different = False  # whether a candidate differs from the members

    def answer(values: dict[str, float]) -> Floats:
        """Return the residuals of a candidate, simulated or read."""
        nonlocal has_different
        if outcome.simulated < len(lines):
            grade, traits, residuals, limited = json.loads(lines[outcome.simulated])
        else:
            if not go_on():
                raise _Stop
            candidate = fly_candidate(values)
            residuals = [
                *candidate.residuals(search.left_out, relieved=bool(search.members)).tolist(),
                *search.pulls(candidate.traits),
            ]
            limited = limit_damping(values, candidate.class_traits)
            if candidate.seen and limited != values:
                candidate = fly_candidate(limited)
            grade, traits = min(rank(candidate, search.left_out), 100.0), candidate.traits
            with file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps([grade, traits, residuals, limited]) + "\n")
        outcome.simulated += 1
        if grade < 100.0:
            outcome.candidates.append(Found(grade, limited, tuple(traits)))
            is_different = search.is_different(tuple(traits))
            has_different |= is_different
            if is_different and grade <= READING:
                outcome.done = True
        if outcome.done or (outcome.simulated >= _PATIENCE and has_different):
            outcome.done = True
            raise _Stop
        return np.array(residuals)

    answers: dict[bytes, Floats] = {}
    slope_calls: list[tuple[Floats, Floats, Floats]] = []  # numbers, residuals, slopes

    def residuals(numbers: Floats) -> Floats:
        key = numbers.tobytes()
        if key not in answers:
            answers[key] = answer(to_values(numbers))
        return answers[key]

    def slopes(numbers: Floats) -> Floats:
        current = residuals(numbers)
        if len(slope_calls) % _DIFFERENCED:  # Broyden's update of the previous slopes
            before, previous, last = slope_calls[-1]
            step = numbers - before
            missing = current - previous - last @ step
            matrix = last + np.outer(missing, step) / max(float(step @ step), 1e-12)
        else:
            middle = 0.5 * (limits()[0] + limits()[1])
            steps = np.where(numbers > middle, -_DIFFERENCE, _DIFFERENCE)  # stays in the box
            matrix = np.stack(
                [
                    (residuals(numbers + step) - current) / step[i]
                    for i, step in enumerate(np.diag(steps))
                ],
                axis=1,
            )
        slope_calls.append((numbers.copy(), current, matrix))
        return matrix

    try:
        numbers = to_numbers(_draw(search, answer))
        for loss, steps in _STAGES:
            options = {"loss": loss, "f_scale": 0.05, "xtol": 1e-3, "ftol": 3e-3, "max_nfev": steps}
            numbers = least_squares(residuals, numbers, slopes, limits(), **options).x
    except _Stop:
        return outcome
    outcome.done = True
    return outcome


def _draw(search: Search, answer: Callable[[dict[str, float]], Floats]) -> dict[str, float]:
    """Return the start of a search, or draw vehicles until both laws can control one."""
    if search.start is not None:
        return search.start
    generator = np.random.default_rng(search.seed)
    best, least = {}, np.inf
    for _ in range(_DRAWS):
        values = first_mean(generator)
        size = float(np.abs(answer(values)).sum())
        if size < least:
            best, least = values, size
        if least < 0.1 * len(FREE):
            break
    return best
