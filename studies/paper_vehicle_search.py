"""One search: from a vehicle of the box to the nearest one whose flights keep to the paper's axes.

Thirty numbers are free and twenty ends are asked for, so few of them are fixed; but searches that ask for nothing more
end near each other. So a search may have an aim and vehicles to be apart from: both pull in the same Gauss-Newton steps
in a trust region (scipy's least_squares) that bring it to the ends and within its sides. Without a start it draws one.
A search is a file of what has been simulated, and goes on from it: the method asks for the same candidates when it is
given the same answers.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from experiment import Floats
from paper_vehicle_box import FREE, first_mean, limits, to_numbers, to_values
from paper_vehicle_flights import FURTHEST, READING, Candidate, fly_candidate, third_trait

ENDS = 18  # of the 20 in their intervals
DIFFERENT = 1.5  # by this factor or in sign, in three traits, any two members differ
OFF_NODE = 0.1  # deg, of the trim from a node of the tables
_DIFFERENCE = 0.03  # of the unit of the search's numbers, for slopes
_DIFFERENCED = 3  # of so many slopes one is of differences
_PATIENCE = 100  # candidates, after which any that differs is enough
_DRAWS = 50
_STAGES = (
    ("linear", 15),
    ("soft_l1", 15),
)  # all ends nearer first; then many in, one or two left out
_CYCLE = 0.05  # of Candidate.cycle: what counts as settled
_APART, _AWAY = 1.55, 2.0  # a factor beyond which nothing pulls away; the pull's weight
_AIM, _PULL = 1.03, 0.12  # a factor beyond which an aim pulls; its weight


@dataclass(frozen=True)
class Search:
    """Where a search begins and what draws it; ``left_out``: a figure whose ends do not count."""

    name: str  # of its file
    seed: int  # of its draws
    left_out: int = 0
    start: dict[str, float] | None = None
    aim: tuple[float, ...] = ()  # the first of TRAITS
    others: tuple[tuple[float, ...], ...] = ()  # traits of vehicles to be apart from

    def pulls(self, traits: tuple[float, ...]) -> list[float]:
        """Return what draws a vehicle to its aim, and away from the others."""
        off = np.log(np.abs(np.array(traits[: len(self.aim)]) / np.array(self.aim)))
        near = (np.log(_APART) - float(third_trait(traits, other)) for other in self.others)
        return [
            *(_PULL * np.sign(off) * np.maximum(np.abs(off) - np.log(_AIM), 0.0)).tolist(),
            *(_AWAY * max(each, 0.0) for each in near),
        ]

    def is_apart(self, traits: tuple[float, ...]) -> bool:
        """Whether a vehicle differs from each of the others."""
        return all(third_trait(traits, other) >= np.log(DIFFERENT) for other in self.others)


@dataclass(frozen=True)
class Found:
    """A candidate that may be a member."""

    rank: float  # ends that are not in, plus the largest miss
    values: dict[str, float]
    traits: tuple[float, ...]


@dataclass
class Outcome:
    """How a search stands: candidates simulated, and which of them may be members."""

    done: bool = False
    flown: int = 0
    found: list[Found] = field(default_factory=list)

    @property
    def best(self) -> Found | None:
        """The candidate of the least rank."""
        return min(self.found, key=lambda each: each.rank, default=None)


class _Stop(Exception):
    """No more time, or nothing more to find."""


def rank(candidate: Candidate, left_out: int = 0) -> float:
    """The ends that are not in plus the largest miss; infinite for what cannot be a member."""
    axes = [each for each in candidate.seen if each.axis.figure != left_out]
    if not axes or candidate.off_node < OFF_NODE or candidate.cycle > _CYCLE:
        return float("inf")
    if not candidate.keeps_sides:
        return float("inf")
    asked = [miss for each in axes if each.axis.counts for miss in each.misses]
    limits_kept = all(max(each.misses) <= READING for each in axes if not each.axis.counts)
    out, worst = sum(miss > READING for miss in asked), max(asked)
    return out + worst if limits_kept and out <= 20 - ENDS and worst <= FURTHEST else float("inf")


def run(search: Search, folder: Path, go_on: Callable[[], bool]) -> Outcome:
    """Run a search until it is done, or until ``go_on`` says no; each line of its file is a candidate's answer."""
    from scipy.optimize import least_squares

    file = folder / f"{search.name}.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    outcome = Outcome()
    apart = False  # whether a candidate that was found differs from the others

    def answer(values: dict[str, float]) -> Floats:
        """The residuals of a candidate, flown or read."""
        nonlocal apart
        if outcome.flown < len(lines):
            grade, traits, residuals = json.loads(lines[outcome.flown])
        else:
            if not go_on():
                raise _Stop
            candidate = fly_candidate(values)
            grade, traits = min(rank(candidate, search.left_out), 100.0), candidate.traits
            residuals = [
                *candidate.residuals(search.left_out, relieved=bool(search.others)).tolist(),
                *search.pulls(traits),
            ]
            with file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps([grade, traits, residuals]) + "\n")
        outcome.flown += 1
        if grade < 100.0:
            outcome.found.append(Found(grade, values, tuple(traits)))
            now = search.is_apart(tuple(traits))
            apart |= now
            if now and grade <= READING:
                outcome.done = True
        if outcome.done or (outcome.flown >= _PATIENCE and apart):
            outcome.done = True
            raise _Stop
        return np.array(residuals)

    known: dict[bytes, Floats] = {}
    slope_calls: list[tuple[Floats, Floats, Floats]] = []  # numbers, residuals, slopes

    def residuals(numbers: Floats) -> Floats:
        key = numbers.tobytes()
        if key not in known:
            known[key] = answer(to_values(numbers))
        return known[key]

    def slopes(numbers: Floats) -> Floats:
        here = residuals(numbers)
        if len(slope_calls) % _DIFFERENCED:  # Broyden's update of the last ones
            before, theirs, last = slope_calls[-1]
            step = numbers - before
            missing = here - theirs - last @ step
            found = last + np.outer(missing, step) / max(float(step @ step), 1e-12)
        else:
            middle = 0.5 * (limits()[0] + limits()[1])
            steps = np.where(numbers > middle, -_DIFFERENCE, _DIFFERENCE)  # never out of the box
            found = np.stack(
                [
                    (residuals(numbers + step) - here) / step[i]
                    for i, step in enumerate(np.diag(steps))
                ],
                axis=1,
            )
        slope_calls.append((numbers.copy(), here, found))
        return found

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
    """Return the start of a search: a given one, or the first vehicle drawn that both laws can control."""
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
