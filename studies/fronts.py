"""Searches for small errors of TLC and LQR within budgets of control effort and the same margins.

    OPENBLAS_NUM_THREADS=1 python studies/fronts.py
        [--vehicle NAME ...] [--law LAW ...] [--rounds R]
        [--work DIR]

The vehicles are three members of the paper's ensemble, each with its own S. Every candidate is
evaluated by its margins in level flight, by 16 flights of the paper's box, whose medians give
errors and usage relative to TLC with Table 1, and by 16 corners of the wide box with 40 ms of
delay, which must neither terminate early nor oscillate.

- *Error*: the root mean square of the three angles' relative errors, so that each angle counts.
- *Usage*: the mean of six ratios, rms from the trim and travel of each surface.
- *Path*: no error of altitude, speed or heading above ``PATH`` times Table 1's; otherwise a law
  could make its commands easy to follow.

In two independent searches, all numbers of a law are free (``robust.py``), within factors that are
equal in terms of bandwidth. The first starts from the printed numbers and from the robust designs
of the default vehicle, the second from random points and is twice as long in the first round. Each
step is a CMA-ES run for small errors within a budget of usage, from the best previous candidate. A
step is stored as a file in ``--work``, from which the command resumes. A round takes about 12
minutes of a core per vehicle; run ``fronts_results.py`` afterwards.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from experiment import ERRORS, FOLLOWING, ROOT, Floats, random_parameters
from robust import FREE
from robust_flights import NOMINAL, RIPPLE, Duel, Flown, box_b

from abhv_mc.io.documents import read_document
from abhv_mc.shipped import find_input
from abhv_mc_tune.candidates import ControllerNumbers
from abhv_mc_tune.constrained_search import Scores, pareto_front, tune
from abhv_mc_vehicle.control.controller_file import Controller, read_controller
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.stability.analysis import margins_of_flights
from abhv_mc_vehicle.vehicle_simulator.tuning import Free

VEHICLES = (
    "seed-2",
    "seed-21",
    "seed-23",
)  # of studies/paper_vehicle.json: the first, and the two that differ most from it
DEFAULT = "abhv"  # of `robust.py`'s designs
LAWS = ("tlc", "lqr")
SEARCHES = (1, 2)
RANDOM = 2  # the search that starts from random points
DRAWN = 128  # number of random points
BUDGETS = (1.0, 0.85, 0.7)  # mean usage over Table 1's
PATH = 1.5
FAR = 0.5  # relative deficit of a margin from which no flights are run
CANDIDATES = 97  # of a step: its start and generations of 16
LONGER = 2  # factor on CANDIDATES from random points and in later rounds
STEP = 0.07  # first standard deviation, of the box -1 .. 1
FACTOR = {"tlc": 10.0, "lqr": 1e4}  # either way
PATHS = [0, 1, 2]  # of ERRORS
ANGLES = [ERRORS.index(name) for name in FOLLOWING]
LIMITS = 4  # margins, lost, cycling, path


@dataclass(frozen=True)
class Tried:
    """Evaluated candidates of one law on one vehicle."""

    points: Floats  # [candidate, free]
    errors: Floats  # [candidate, ERRORS] over Table 1's
    usage: Floats  # [candidate, USAGE] over Table 1's
    limits: Floats  # [candidate, LIMITS], positive if violated

    @property
    def score(self) -> Floats:
        """Root mean square of the three angles' errors ``[candidate]``."""
        return np.asarray(np.sqrt((self.errors[:, ANGLES] ** 2).mean(axis=1)))

    @property
    def mean_usage(self) -> Floats:
        """Mean of the six ratios ``[candidate]``."""
        return np.asarray(self.usage.mean(axis=1))

    def within(self, budget: float) -> Scores:
        """Return the scores for small errors within a budget."""
        excess = np.column_stack([self.limits, self.mean_usage / budget - 1.0])
        return Scores(self.score, excess, self.mean_usage)

    @property
    def feasible(self) -> "Tried":
        """Candidates that satisfy every limit."""
        return self.rows(np.flatnonzero((self.limits <= 0.0).all(axis=1)))

    @property
    def front(self) -> "Tried":
        """Pareto-optimal feasible candidates in error and mean usage, by usage."""
        within_limits = self.feasible
        return within_limits.rows(
            pareto_front(np.column_stack([within_limits.mean_usage, within_limits.score]))
        )

    def rows(self, selected: np.ndarray) -> "Tried":
        """Return some of the candidates."""
        return Tried(
            *(
                column_group[selected]
                for column_group in (self.points, self.errors, self.usage, self.limits)
            )
        )

    @property
    def table(self) -> Floats:
        """All values as one array ``[candidate, column]``."""
        return np.hstack([self.points, self.errors, self.usage, self.limits])


def tried_of(table: Floats) -> Tried:
    """Return the candidates of a :attr:`Tried.table`."""
    first = table.shape[1] - LIMITS - 12
    return Tried(*np.split(table, [first, first + 6, first + 12], axis=1))


def hard_corners() -> Floats:
    """Return 16 of the 64 corners of the wide box with the longest delay."""
    signs = np.array(list(product((-1.0, 1.0), repeat=4)))
    a, b, c, d = signs.T
    rows = nominal_parameters(16)
    box_b(rows, np.column_stack([signs, a * b * c, b * c * d, np.ones(16)]))
    return rows


class Trials:
    """Evaluation of candidates of one law on one vehicle."""

    def __init__(self, vehicle: str, law: str) -> None:
        self.duel, self.law = Duel(vehicle, law), law
        self.flights = np.vstack([random_parameters(16, seed=1), hard_corners()])
        self.table_1 = self.medians(self.duel.fly(self.duel.table_1_plan, self.flights))
        document = read_document(find_input(law, "control"))
        self.numbers = ControllerNumbers(
            document, tuple(Free(key=key, factor=FACTOR[law]) for key in FREE[law])
        )

    @staticmethod
    def medians(flown: Flown) -> tuple[Floats, Floats]:
        """Return the medians of errors and usage in the paper's box."""
        return np.median(flown.errors[:16], axis=0), np.median(flown.usage[:16], axis=0)

    def point_of(self, file: str) -> Floats:
        """Return the point of a controller file, limited to the box."""
        data = read_document(find_input(file, "control"))
        theirs, ours = (
            ControllerNumbers(document, self.numbers.free)
            for document in (data, self.numbers.document)
        )
        nothing = np.zeros(len(self.numbers.free))
        ratios = [
            float(str(value).split()[0]) / float(str(own_value).split()[0])
            for value, own_value in zip(
                theirs.values(nothing).values(), ours.values(nothing).values(), strict=True
            )
        ]
        return np.clip(np.log(ratios) / np.log(FACTOR[self.law]), -0.98, 0.98)

    def controller(self, point: Floats) -> Controller:
        """Return the controller of a point, as read from its file."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "candidate.yaml"
            self.numbers.write(path, point)
            return read_controller(path)

    def evaluate(self, point: Floats) -> Floats:
        """Return a row of :attr:`Tried.table`."""
        bad = np.hstack([point, np.full(12, 9.0), np.ones(LIMITS)])
        try:
            plan, steady = self.duel.plans(self.controller(point))
        except np.linalg.LinAlgError:
            return bad
        margins = margins_of_flights(plan, steady, self.duel.corners[:1], ["trim"], 100).table[
            0, :3
        ]
        bad[-LIMITS] = short = float(((NOMINAL - margins) / NOMINAL).max())
        if short > FAR:
            return bad
        flown = self.duel.fly(plan, self.flights)
        errors, usage = (
            np.nan_to_num(ours / theirs, nan=9.0)
            for ours, theirs in zip(self.medians(flown), self.table_1, strict=True)
        )
        cycles = min(float(np.nanmax(flown.ripples, initial=0.0)) / RIPPLE - 1.0, 1.0)
        path = float(np.log(errors[PATHS].max() / PATH))  # never flat, unlike a clipped excess
        return np.hstack(
            [point, errors, np.maximum(usage, 1e-3), short, flown.lost / 10.0, cycles, path]
        )

    def measure(self, points: Floats) -> Tried:
        """Evaluate candidates ``[candidate, free]``."""
        return tried_of(np.array([self.evaluate(point) for point in points]))


class Archive:
    """Files with all candidates of a vehicle, one per step."""

    def __init__(self, work: Path, vehicle: str) -> None:
        self.folder, self.vehicle = work / vehicle, vehicle
        self.folder.mkdir(parents=True, exist_ok=True)

    def file(self, law: str, search: int, step: str) -> Path:
        """Return the path of a step's file."""
        return self.folder / f"{law}-{search}-{step}.npz"

    def tried(self, law: str, searches: tuple[int, ...]) -> Tried:
        """Return all candidates of some searches."""
        files = [
            file
            for search in searches
            for file in sorted(self.folder.glob(f"{law}-{search}-*.npz"))
        ]
        nothing = np.empty((0, len(FREE[law]) + 12 + LIMITS))
        return tried_of(np.vstack([nothing, *(np.load(file)["table"] for file in files)]))

    def starts(self, trials: Trials, law: str, search: int) -> Floats:
        """Return the points from which a search starts."""
        if search == RANDOM:
            return np.random.default_rng(1000 * search).uniform(-0.5, 0.5, (DRAWN, len(FREE[law])))
        return np.array([trials.point_of(file) for file in (law, f"{law}_robust_{DEFAULT}")])

    def seconds(self) -> float:
        """Return the time of all steps, s."""
        return sum(float(np.load(file)["seconds"]) for file in self.folder.glob("*.npz"))


def steps(rounds: int) -> Iterator[tuple[int, str, float]]:
    """Yield number, law and budget (0 for the starting points) of each step of a search."""
    for number, budget in enumerate((0.0, *(BUDGETS * rounds))):
        for law in LAWS:
            yield number, law, budget


def run_step(trials: Trials, archive: Archive, search: int, step: tuple[int, str, float]) -> None:
    """Run a step unless its file exists."""
    number, law, budget = step
    file = archive.file(law, search, f"{number:02d}-{budget:g}")
    if file.exists():
        return
    batches: list[Tried] = []
    begun, aim = time.perf_counter(), budget or BUDGETS[0]

    def measure(points: Floats) -> Scores:
        batches.append(trials.measure(points))
        return batches[-1].within(aim)

    if not budget:
        measure(archive.starts(trials, law, search))
    else:
        before = archive.tried(law, (search,))
        start = before.points[int(np.argmin(before.within(aim).rank()))]
        longer = 1 if number <= len(BUDGETS) and search != RANDOM else LONGER
        tune(measure, start, longer * CANDIDATES, seed=1000 * search + number, step=STEP)
    table = np.vstack([batch.table for batch in batches])
    with tempfile.NamedTemporaryFile(dir=archive.folder, suffix=".tmp", delete=False) as into:
        np.savez_compressed(into, table=table, seconds=time.perf_counter() - begun)
    Path(into.name).replace(file)
    tried = tried_of(table)
    best = tried.rows(np.array([int(np.argmin(tried.within(aim).rank()))]))
    print(
        f"{archive.vehicle} search {search} step {number} {law} {aim:g}: error "
        f"{best.score[0]:.3f}, usage {best.mean_usage[0]:.3f}, beyond "
        f"{best.within(aim).excess.max():.3f} {np.round(best.errors[0], 2)} "
        f"{np.round(best.usage[0], 2)}",
        flush=True,
    )


def main() -> None:
    """Run or resume the searches."""
    parser = argparse.ArgumentParser(description="Fronts of error against usage for TLC and LQR.")
    parser.add_argument("--vehicle", nargs="+", choices=VEHICLES, default=VEHICLES)
    parser.add_argument("--law", nargs="+", choices=LAWS, default=LAWS)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--work", type=Path, default=ROOT / "build/fronts")
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    if arguments.smoke:
        trials = Trials(VEHICLES[0], "lqr")
        start = trials.point_of("lqr")
        print(tune(lambda points: trials.measure(points).within(BUDGETS[0]), start, 1, step=STEP))
        return
    for vehicle in arguments.vehicle:
        archive = Archive(arguments.work, vehicle)
        trials = {law: Trials(vehicle, law) for law in arguments.law}
        for step in steps(arguments.rounds):
            for search in SEARCHES:
                if step[1] in arguments.law:
                    run_step(trials[step[1]], archive, search, step)


if __name__ == "__main__":
    main()
