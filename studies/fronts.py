"""Error against control usage for both laws within the same margins: searches that resume, and what they found.

    OPENBLAS_NUM_THREADS=1 python studies/fronts.py [--vehicle NAME ...] [--law LAW ...] [--rounds R] [--work DIR]

Three members of the paper's ensemble, each with its own S. Of every candidate: the margins in level flight, 16 flights
of the paper's box, whose medians give errors and usage over those of TLC with Table 1, and 16 corners of the wide box
with 40 ms of delay, which are neither lost nor cycle.
- *Error*: the root mean square of the three angles' relative errors, so that none is given up for the others.
- *Usage*: the mean of six ratios, rms from the trim and travel of each surface.
- *Path*: no error of altitude, speed or heading above ``PATH`` times the larger of the printed designs'; or a law would
  follow commands that it makes easy.
Two searches of 14 free entries share nothing: the first starts from the printed gains and the robust ones of
`ghame_x`, the second from random points and twice as long. Each step is a CMA-ES for small errors within a budget of
usage, from the best candidate so far for it. A step is a file in ``--work``: the command goes on where it stopped.
A round takes some 12 minutes of a core a vehicle; then ``fronts_results.py``.
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

from abhv_mc.campaign.file.tuning import Free
from abhv_mc.control.controller_file import Controller, read_controller
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.prepare import make_plan
from abhv_mc.io.documents import read_document
from abhv_mc.shipped import find_input
from abhv_mc.stability.analysis import margins_of_flights
from abhv_mc_tune.candidates import ControllerNumbers
from abhv_mc_tune.constrained_search import Scores, pareto_front, tune

VEHICLES = (
    "seed-2",
    "seed-21",
    "seed-23",
)  # of studies/paper_vehicle.json: abhv, and the two that differ most from it
LAWS = ("tlc", "lqr")
SEARCHES = (1, 2)
RANDOM = 2  # the search that begins with random points
DRAWN = 128  # of them
BUDGETS = (1.0, 0.85, 0.7)  # mean usage over Table 1's
PATH = 1.5
FAR = 0.5  # short of a margin, relative: not worth flying
CANDIDATES = 97  # of a step: its start and generations of 16
LONGER = 2  # times as many from random points and in later rounds
STEP = 0.07  # first standard deviation, of the box -1 .. 1
FACTOR = {"tlc": 20.0, "lqr": 1000.0}  # either way
PATHS = [0, 1, 2]  # of ERRORS
ANGLES = [ERRORS.index(name) for name in FOLLOWING]
LIMITS = 4  # margins, lost, cycling, path
MORE = ("velocity.flight_path_angle.bandwidth", "velocity.heading.bandwidth")
KEYS = {"tlc": (*FREE["tlc"], *MORE), "lqr": FREE["lqr"]}


@dataclass(frozen=True)
class Tried:
    """Candidates of one law on one vehicle."""

    points: Floats  # [candidate, free]
    errors: Floats  # [candidate, ERRORS] over Table 1's
    usage: Floats  # [candidate, USAGE] over Table 1's
    limits: Floats  # [candidate, LIMITS]: above zero where one is broken

    @property
    def score(self) -> Floats:
        """Root mean square of the three angles' errors ``[candidate]``."""
        return np.asarray(np.sqrt((self.errors[:, ANGLES] ** 2).mean(axis=1)))

    @property
    def mean_usage(self) -> Floats:
        """Mean of the six ratios ``[candidate]``."""
        return np.asarray(self.usage.mean(axis=1))

    def within(self, budget: float) -> Scores:
        """Small errors within a budget."""
        excess = np.column_stack([self.limits, self.mean_usage / budget - 1.0])
        return Scores(self.score, excess, self.mean_usage)

    @property
    def kept(self) -> "Tried":
        """Those that keep every limit."""
        return self.rows(np.flatnonzero((self.limits <= 0.0).all(axis=1)))

    @property
    def front(self) -> "Tried":
        """Those of :attr:`kept` that none beats in error and mean usage, by usage."""
        kept = self.kept
        return kept.rows(pareto_front(np.column_stack([kept.mean_usage, kept.score])))

    def rows(self, which: np.ndarray) -> "Tried":
        """Some of them."""
        return Tried(*(part[which] for part in (self.points, self.errors, self.usage, self.limits)))

    @property
    def table(self) -> Floats:
        """All in one array ``[candidate, column]``."""
        return np.hstack([self.points, self.errors, self.usage, self.limits])


def tried_of(table: Floats) -> Tried:
    """From :attr:`Tried.table`."""
    first = table.shape[1] - LIMITS - 12
    return Tried(*np.split(table, [first, first + 6, first + 12], axis=1))


def hard_corners() -> Floats:
    """16 corners of the wide box with the longest delay: a fraction of the other six signs' 64."""
    signs = np.array(list(product((-1.0, 1.0), repeat=4)))
    a, b, c, d = signs.T
    rows = nominal_parameters(16)
    box_b(rows, np.column_stack([signs, a * b * c, b * c * d, np.ones(16)]))
    return rows


class Trials:
    """Measures candidates of one law on one vehicle."""

    def __init__(self, vehicle: str, law: str) -> None:
        self.duel, self.law = Duel(vehicle, law), law
        self.flights = np.vstack([random_parameters(16, seed=1), hard_corners()])
        self.table_1 = self.medians(self.duel.fly(self.duel.table_1_plan, self.flights))
        printed = read_controller(ROOT / "configs/control/lqr.yaml")
        plan = make_plan(self.duel.vehicle, self.duel.mission, printed, "lqr")
        printed_path = self.medians(self.duel.fly(plan, self.flights))[0][PATHS]
        self.path = np.maximum(printed_path / self.table_1[0][PATHS], 1.0)
        document = read_document(find_input(f"{law}_robust_ghame_x", "control"))
        self.numbers = ControllerNumbers(
            document, tuple(Free(key=key, factor=FACTOR[law]) for key in KEYS[law])
        )

    @staticmethod
    def medians(flown: Flown) -> tuple[Floats, Floats]:
        """Errors and usage of the paper's box."""
        return np.median(flown.errors[:16], axis=0), np.median(flown.usage[:16], axis=0)

    def place(self, file: str) -> Floats:
        """The point of a controller's file; what lies beyond the box comes to its edge."""
        data = read_document(find_input(file, "control"))
        theirs, ours = (
            ControllerNumbers(each, self.numbers.free) for each in (data, self.numbers.document)
        )
        nothing = np.zeros(len(self.numbers.free))
        ratios = [
            float(str(there).split()[0]) / float(str(here).split()[0])
            for there, here in zip(
                theirs.values(nothing).values(), ours.values(nothing).values(), strict=True
            )
        ]
        return np.clip(np.log(ratios) / np.log(FACTOR[self.law]), -0.98, 0.98)

    def controller(self, point: Floats) -> Controller:
        """The controller of a point, as its file would be read."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "candidate.yaml"
            self.numbers.write(path, point)
            return read_controller(path)

    def one(self, point: Floats) -> Floats:
        """A row of :attr:`Tried.table`."""
        bad = np.hstack([point, np.full(12, 9.0), np.ones(LIMITS)])
        try:
            plan, steady = self.duel.plans(self.controller(point))
        except np.linalg.LinAlgError:
            return bad
        found = margins_of_flights(plan, steady, self.duel.corners[:1], ["trim"], 100).table[0, :3]
        bad[-LIMITS] = short = float(((NOMINAL - found) / NOMINAL).max())
        if short > FAR:
            return bad
        flown = self.duel.fly(plan, self.flights)
        errors, usage = (
            np.nan_to_num(ours / theirs, nan=9.0)
            for ours, theirs in zip(self.medians(flown), self.table_1, strict=True)
        )
        cycles = min(float(np.nanmax(flown.ripples, initial=0.0)) / RIPPLE - 1.0, 1.0)
        path = min(float((errors[PATHS] / self.path).max()) / PATH - 1.0, 1.0)
        return np.hstack(
            [point, errors, np.maximum(usage, 1e-3), short, flown.lost / 10.0, cycles, path]
        )

    def measure(self, points: Floats) -> Tried:
        """Candidates ``[candidate, free]``."""
        return tried_of(np.array([self.one(point) for point in points]))


class Archive:
    """All candidates of a vehicle, as the steps' files hold them."""

    def __init__(self, work: Path, vehicle: str) -> None:
        self.folder, self.vehicle = work / vehicle, vehicle
        self.folder.mkdir(parents=True, exist_ok=True)

    def file(self, law: str, search: int, step: str) -> Path:
        """Where a step is kept."""
        return self.folder / f"{law}-{search}-{step}.npz"

    def tried(self, law: str, searches: tuple[int, ...]) -> Tried:
        """Everything that these searches tried."""
        files = [
            file
            for search in searches
            for file in sorted(self.folder.glob(f"{law}-{search}-*.npz"))
        ]
        nothing = np.empty((0, len(KEYS[law]) + 12 + LIMITS))
        return tried_of(np.vstack([nothing, *(np.load(file)["table"] for file in files)]))

    def starts(self, trials: Trials, law: str, search: int) -> Floats:
        """Points that a search begins with."""
        if search == RANDOM:
            return np.random.default_rng(1000 * search).uniform(-0.5, 0.5, (DRAWN, len(KEYS[law])))
        return np.array([trials.place(file) for file in (law, f"{law}_robust_ghame_x")])

    def seconds(self) -> float:
        """What the steps took."""
        return sum(float(np.load(file)["seconds"]) for file in self.folder.glob("*.npz"))


def steps(rounds: int) -> Iterator[tuple[int, str, float]]:
    """Number, law and budget (none: the starts) of each step of a search."""
    for number, budget in enumerate((0.0, *(BUDGETS * rounds))):
        for law in LAWS:
            yield number, law, budget


def run_step(trials: Trials, archive: Archive, search: int, step: tuple[int, str, float]) -> None:
    """One step, unless it is kept already."""
    number, law, budget = step
    file = archive.file(law, search, f"{number:02d}-{budget:g}")
    if file.exists():
        return
    parts: list[Tried] = []
    begun, aim = time.perf_counter(), budget or BUDGETS[0]

    def measure(points: Floats) -> Scores:
        parts.append(trials.measure(points))
        return parts[-1].within(aim)

    if not budget:
        measure(archive.starts(trials, law, search))
    else:
        before = archive.tried(law, (search,))
        start = before.points[int(np.argmin(before.within(aim).rank()))]
        longer = 1 if number <= len(BUDGETS) and search != RANDOM else LONGER
        tune(measure, start, longer * CANDIDATES, seed=1000 * search + number, step=STEP)
    table = np.vstack([part.table for part in parts])
    with tempfile.NamedTemporaryFile(dir=archive.folder, suffix=".tmp", delete=False) as into:
        np.savez_compressed(into, table=table, seconds=time.perf_counter() - begun)
    Path(into.name).replace(file)
    found = tried_of(table)
    best = found.rows(np.array([int(np.argmin(found.within(aim).rank()))]))
    print(
        f"{archive.vehicle} search {search} step {number} {law} {aim:g}: error {best.score[0]:.3f}, "
        f"usage {best.mean_usage[0]:.3f}, beyond {best.within(aim).excess.max():.3f} "
        f"{np.round(best.errors[0], 2)} {np.round(best.usage[0], 2)}",
        flush=True,
    )


def main() -> None:
    """Search, and go on where a search stopped."""
    parser = argparse.ArgumentParser(description="Fronts of error against usage for TLC and LQR.")
    parser.add_argument("--vehicle", nargs="+", choices=VEHICLES, default=VEHICLES)
    parser.add_argument("--law", nargs="+", choices=LAWS, default=LAWS)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--work", type=Path, default=ROOT / "build/fronts")
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    if arguments.smoke:
        trials = Trials(VEHICLES[0], "lqr")
        print(trials.measure(trials.place("lqr")[None]))
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
