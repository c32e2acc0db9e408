"""Evaluation record and random streams shared by all search algorithms."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from abhv_mc.array_types import Floats

# function that returns the values [point] of points [point, dimension]
Evaluate = Callable[[Floats], Floats]

# number of flights that compiled code simulates in parallel; batch sizes are its multiples
LANES = 32


def make_generator(seed: int, *key: int) -> np.random.Generator:
    """Return the random generator for a seed and a key such as (repetition, level, step)."""
    return np.random.Generator(
        np.random.Philox(np.random.SeedSequence(entropy=seed, spawn_key=key))
    )


def round_up(number: int, multiple: int = LANES) -> int:
    """Return the smallest multiple of `multiple` that is not less than `number`."""
    return -(-number // multiple) * multiple


@dataclass(frozen=True)
class Progress:
    """Best value after a batch of evaluations."""

    evaluations: int
    best: float
    stage: str


@dataclass
class Record:
    """Evaluated points of the box -1 .. 1 and their values; NaN counts as the worst value."""

    evaluate: Evaluate
    limit: int  # maximum number of evaluations
    # evaluated points of each batch [point, dimension]
    points: list[Floats] = field(default_factory=list)
    values: list[Floats] = field(default_factory=list)  # values of each batch [point]
    history: list[Progress] = field(default_factory=list)
    best: float = -np.inf
    place: Floats = field(
        default_factory=lambda: np.empty(0)
    )  # coordinates of the best point; empty before the first evaluation

    @property
    def used(self) -> int:
        """Number of evaluations so far."""
        return sum(map(len, self.values))

    @property
    def left(self) -> int:
        """Number of evaluations left."""
        return self.limit - self.used

    def call(self, points: Floats, stage: str) -> Floats:
        """Evaluate points [point, dimension] and return their values [point]."""
        values = self.evaluate(points)
        values = np.where(np.isnan(values), -np.inf, values)
        self.points.append(points)
        self.values.append(values)
        top = int(np.argmax(values))
        if not self.place.size or values[top] > self.best:
            self.best, self.place = float(values[top]), points[top].copy()
        self.history.append(Progress(self.used, self.best, stage))
        return values

    def best_places(self, number: int, min_distance: float) -> Floats:
        """Return up to `number` of the best points that are at least `min_distance` apart.

        The distance of two points is the rms of their differences over the dimensions.
        """
        order = np.argsort(-np.concatenate(self.values), kind="stable")
        points = np.concatenate(self.points)[order]
        chosen: list[Floats] = []
        while len(points) and len(chosen) < number:
            chosen.append(points[0])
            points = points[np.sqrt(np.mean((points - points[0]) ** 2, axis=1)) >= min_distance]
        return np.array(chosen)
