"""One search: from a random vehicle of the box to the nearest one whose flights keep to the paper's axes.

Thirty numbers are free and twenty ends are asked for, so few of them are fixed. Gauss-Newton steps in a trust region
(scipy's least_squares) change no more than the ends need, and so keep searches from different starts apart, where a
search for the single best vehicle would bring them together. A search is a file of what has been flown, and goes on
from it: the method asks for the same candidates when it is given the same answers.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from experiment import Floats
from paper_vehicle_box import FREE, first_mean, limits, to_numbers, to_values
from paper_vehicle_flights import FURTHEST, READING, Candidate, fly_candidate

ENDS = 18  # of the 20 in their intervals
OFF_NODE = 0.1  # deg, of the trim from a node of the tables
_DIFFERENCE = 0.03  # of the unit of the search's numbers, for slopes
_DRAWS = 50
_STAGES = (("linear", 12), ("soft_l1", 12))  # all ends nearer first; then many in, one or two left out
_CYCLE = 0.05  # of Candidate.cycle: what counts as settled


@dataclass(frozen=True)
class Search:
    """From the vehicle that a seed draws; ``left_out``: a figure whose ends do not count."""

    seed: int
    left_out: int = 0

    @property
    def name(self) -> str:
        """Of its file."""
        return f"seed-{self.seed}" + (f"-without-{self.left_out}" if self.left_out else "")


@dataclass
class Outcome:
    """How a search stands: candidates flown, and the best one that it accepts, with how far that is out."""

    done: bool
    flown: int
    rank: float  # ends that are not in, plus the largest miss
    values: dict[str, float] | None


class _Stop(Exception):
    """No more time."""


def rank(candidate: Candidate, left_out: int = 0) -> float:
    """The ends that are not in plus the largest miss; infinite for what cannot be a member."""
    axes = [each for each in candidate.seen if each.axis.figure != left_out]
    if not axes or candidate.off_node < OFF_NODE or candidate.cycle > _CYCLE:
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
    outcome = Outcome(False, 0, float("inf"), None)

    def answer(values: dict[str, float]) -> Floats:
        """The residuals of a candidate, flown or read."""
        if outcome.flown < len(lines):
            found, residuals = json.loads(lines[outcome.flown])
        else:
            if not go_on():
                raise _Stop
            candidate = fly_candidate(values)
            found = min(rank(candidate, search.left_out), 100.0)
            residuals = candidate.residuals(search.left_out).tolist()
            with file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps([found, residuals]) + "\n")
        outcome.flown += 1
        if found < min(outcome.rank, 100.0):
            outcome.rank, outcome.values = found, values
        return np.array(residuals)

    def residuals(numbers: Floats) -> Floats:
        return answer(to_values(numbers))

    def slopes(numbers: Floats) -> Floats:
        here = residuals(numbers)
        middle = 0.5 * (limits()[0] + limits()[1])
        steps = np.where(numbers > middle, -_DIFFERENCE, _DIFFERENCE)  # never out of the box
        return np.stack([(residuals(numbers + step) - here) / step[i] for i, step in enumerate(np.diag(steps))], axis=1)

    try:
        numbers = to_numbers(_draw(search.seed, answer))
        for loss, steps in _STAGES:
            options = {"loss": loss, "f_scale": 0.05, "xtol": 1e-3, "ftol": 3e-3, "max_nfev": steps}
            numbers = least_squares(residuals, numbers, slopes, limits(), **options).x
    except _Stop:
        return outcome
    outcome.done = True
    return outcome


def _draw(seed: int, answer: Callable[[dict[str, float]], Floats]) -> dict[str, float]:
    """The first vehicle of the box that a seed draws and that both laws fly to the end."""
    generator = np.random.default_rng(seed)
    best, least = {}, np.inf
    for _ in range(_DRAWS):
        values = first_mean(generator)
        size = float(np.abs(answer(values)).sum())
        if size < least:
            best, least = values, size
        if least < 0.1 * len(FREE):
            break
    return best
