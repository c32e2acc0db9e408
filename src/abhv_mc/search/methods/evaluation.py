"""What every search asks of its caller, what it has evaluated so far, and where its random numbers come from."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from abhv_mc.array_types import Floats

Evaluate = Callable[[Floats], Floats]  # values [point] of the points [point, dimension]

LANES = 32  # flights that compiled code flies side by side: batches are multiples of it


def make_generator(seed: int, *place: int) -> np.random.Generator:
    """The generator of one place in a search (repetition, level, step, ...), independent of all others."""
    return np.random.Generator(
        np.random.Philox(np.random.SeedSequence(entropy=seed, spawn_key=place))
    )


def round_up(number: int, multiple: int = LANES) -> int:
    """The smallest multiple that is not below ``number``."""
    return -(-number // multiple) * multiple


@dataclass(frozen=True)
class Progress:
    """The best value once a batch was evaluated."""

    evaluations: int
    best: float
    stage: str


@dataclass
class Record:
    """Evaluates points of the box -1 .. 1 and remembers them; larger values are better, not-a-number is worst."""

    evaluate: Evaluate
    limit: int  # evaluations in all
    points: list[Floats] = field(default_factory=list)  # of each batch: [point, dimension]
    values: list[Floats] = field(default_factory=list)  # of each batch: [point]
    history: list[Progress] = field(default_factory=list)
    best: float = -np.inf
    place: Floats = field(
        default_factory=lambda: np.empty(0)
    )  # of the best; [dimension] once there is one

    @property
    def used(self) -> int:
        """Evaluations so far."""
        return sum(map(len, self.values))

    @property
    def left(self) -> int:
        """Evaluations that are left."""
        return self.limit - self.used

    def call(self, points: Floats, stage: str) -> Floats:
        """Values ``[point]`` of points ``[point, dimension]``."""
        values = self.evaluate(points)
        values = np.where(np.isnan(values), -np.inf, values)
        self.points.append(points)
        self.values.append(values)
        top = int(np.argmax(values))
        if not self.place.size or values[top] > self.best:
            self.best, self.place = float(values[top]), points[top].copy()
        self.history.append(Progress(self.used, self.best, stage))
        return values

    def best_places(self, number: int, apart: float) -> Floats:
        """The best places, at most ``number``, each at least ``apart`` (rms over the dimensions) from better ones."""
        order = np.argsort(-np.concatenate(self.values), kind="stable")
        points = np.concatenate(self.points)[order]
        chosen: list[Floats] = []
        while len(points) and len(chosen) < number:
            chosen.append(points[0])
            points = points[np.sqrt(np.mean((points - points[0]) ** 2, axis=1)) >= apart]
        return np.array(chosen)
