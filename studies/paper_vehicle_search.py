"""One search: from a random vehicle of the box to the nearest one whose flights keep to the paper's axes.

Thirty numbers are free and twenty ends are asked for, so few of them are fixed; but searches that ask for nothing more
end near each other. So each seed is drawn to a place of its own, levels of six traits (`LEVELS`), and away from the
shipped vehicle, from which it has to differ, by the same Gauss-Newton steps in a trust region (scipy's least_squares)
that bring its vehicle to the ends and within its sides. A search is a file of what has been flown, and goes on from
it: the method asks for the same candidates when it is given the same answers.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from experiment import ROOT, Floats
from paper_vehicle_box import FREE, first_mean, limits, to_numbers, to_values
from paper_vehicle_flights import FURTHEST, READING, TRAITS, Candidate, fly_candidate, third_trait

STARTS = ROOT / "studies/paper_vehicle_starts.json"  # of a seed: found with earlier revisions
ENDS = 18  # of the 20 in their intervals
DIFFERENT = 1.5  # by this factor or in sign, in three traits, any two members differ
OFF_NODE = 0.1  # deg, of the trim from a node of the tables
_DIFFERENCE = 0.03  # of the unit of the search's numbers, for slopes
_DIFFERENCED = 3  # of so many slopes one is of differences
_PATIENCE = 150  # candidates, after which any member is enough
_DRAWS = 50
_STAGES = (
    ("linear", 15),
    ("soft_l1", 15),
)  # all ends nearer first; then many in, one or two left out
_CYCLE = 0.05  # of Candidate.cycle: what counts as settled
LEVELS = {  # a trait of the place 0; a step up or down is STEP times more or less. Moments of roll and yaw go
    # together: the figures leave their common size free and fix their ratios to 1.5 or so
    "aileron": 117.0,
    "rudder": 19.9,
    "sideslip": 10.9,
    "elevator": 2.1,
    "angle_of_attack": 3.4,
    "rates": 0.53,
}
STEP, _AIM, _APART = 1.65, 1.12, 1.55  # nothing pulls within _AIM of a level, or beyond _APART
_SIZES = (0, 1, -1, 2)  # places of aileron, rudder and sideslip
_PITCH = (-1, 0, 1)  # of elevator, angle of attack and rates
_PULL = 0.25


@dataclass(frozen=True)
class Search:
    """From the vehicle that a seed draws; ``left_out``: a figure whose ends do not count."""

    seed: int
    left_out: int = 0
    others: tuple[tuple[float, ...], ...] = ()  # traits of earlier members

    @property
    def name(self) -> str:
        """Of its file."""
        return f"seed-{self.seed}" + (f"-without-{self.left_out}" if self.left_out else "")

    @property
    def place(self) -> tuple[int, ...]:
        """Return the level of each trait in LEVELS: twelve places, any two apart in three traits."""
        size, pitch = divmod(self.seed - 1, len(_PITCH))
        return (*(_SIZES[size % len(_SIZES)],) * 3, *(_PITCH[pitch],) * 3)

    def aside(self, traits: tuple[float, ...]) -> Floats:
        """By which factor each trait in LEVELS lies off its level, logarithmic."""
        found = dict(zip(TRAITS, traits, strict=True)) if traits else dict.fromkeys(LEVELS, 1.0)
        off = [np.log(abs(found[name]) / LEVELS[name]) for name in LEVELS]
        return np.array(off) - np.log(STEP) * np.array(self.place)

    def pulls(self, traits: tuple[float, ...]) -> list[float]:
        """What draws a vehicle to its place, and away from the member that is nearest in the third of its traits."""
        aside = self.aside(traits)
        pull = np.sign(aside) * np.clip(np.abs(aside) - np.log(_AIM), 0.0, 2.0)
        near = max(
            (np.log(_APART) - third_trait(traits, other) for other in self.others if traits),
            default=0.0,
        )
        return [*(_PULL * float(x) for x in pull), max(near, 0.0)]


@dataclass
class Outcome:
    """How a search stands: candidates flown, and the best one that it accepts, with how far that is out."""

    done: bool
    flown: int
    rank: float  # ends that are not in, plus the largest miss
    values: dict[str, float] | None


class _Stop(Exception):
    """No more time, or nothing more to find."""


def rank(candidate: Candidate, search: Search) -> float:
    """The ends that are not in plus the largest miss; infinite for what cannot be a member."""
    axes = [each for each in candidate.seen if each.axis.figure != search.left_out]
    if not axes or candidate.off_node < OFF_NODE or candidate.cycle > _CYCLE:
        return float("inf")
    if not candidate.keeps_sides:
        return float("inf")
    if not all(
        third_trait(candidate.traits, other) >= np.log(DIFFERENT) for other in search.others
    ):
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
            found = min(rank(candidate, search), 100.0)
            residuals = [
                *candidate.residuals(search.left_out).tolist(),
                *search.pulls(candidate.traits),
            ]
            with file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps([found, residuals]) + "\n")
        outcome.flown += 1
        if found < min(outcome.rank, 100.0):
            outcome.rank, outcome.values = found, values
        if outcome.rank <= READING or (outcome.flown >= _PATIENCE and outcome.values is not None):
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


def stored_start(seed: int) -> dict[str, float]:
    """Return the values that a seed's search begins with, empty where they are drawn."""
    return dict(json.loads(STARTS.read_text(encoding="utf-8")).get(f"seed-{seed}", {}))


def _draw(search: Search, answer: Callable[[dict[str, float]], Floats]) -> dict[str, float]:
    """Return the start of a search: a stored one, or the first vehicle drawn that both laws can control."""
    if search.left_out == 0 and (stored := stored_start(search.seed)):
        return stored
    seed = search.seed
    generator = np.random.default_rng(seed)
    best, least = {}, np.inf
    for _ in range(_DRAWS):
        values = first_mean(generator)
        size = float(np.abs(answer(values)[: -len(LEVELS) - 1]).sum())
        if size < least:
            best, least = values, size
        if least < 0.1 * len(FREE):
            break
    return best
