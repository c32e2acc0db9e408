"""What every search asks of its caller, and where its random numbers come from."""

from collections.abc import Callable

import numpy as np

from abhv_mc.array_types import Floats

Evaluate = Callable[[Floats], Floats]  # values [point] of the points [point, dimension]

LANES = 32  # flights that compiled code flies side by side: batches are multiples of it


def make_generator(seed: int, *place: int) -> np.random.Generator:
    """The generator of one place in a search (repetition, level, step, ...), independent of all others."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(entropy=seed, spawn_key=place)))


def round_up(number: int, multiple: int = LANES) -> int:
    """The smallest multiple that is not below ``number``."""
    return -(-number // multiple) * multiple
