"""Whether a user's simulator gives the same flight of the same inputs again, and what follows from it."""

from collections.abc import Iterable
from enum import StrEnum

import numpy as np

from abhv_mc.array_types import Floats

ROUNDING = 1e-9  # of the larger value: a smaller difference is no noise


class Repeatability(StrEnum):
    """What the first flights of a campaign showed; the later value outweighs the earlier ones."""

    EXACT = "yes"
    ROUNDING = "rounding"
    DECLARED = "no, independent noise"  # `repeatable: no`, and nothing contradicts it
    NOISE = "no"
    SHARED = "no, noise that processes share"

    @property
    def is_evidence(self) -> bool:
        """Whether flights may count as independent draws."""
        return self not in (Repeatability.NOISE, Repeatability.SHARED)

    @property
    def sentence(self) -> str:
        """What a reader has to know."""
        return _SENTENCES[self]


_SENTENCES = {
    Repeatability.EXACT: "The first flights gave the same numbers in two new processes, bit for bit.",
    Repeatability.ROUNDING: "The first flights gave the same numbers in two new processes up to rounding "
    f"(at most {ROUNDING:g} of the value); re-run flights are compared with that tolerance.",
    Repeatability.DECLARED: "The simulator draws noise (`repeatable: no`) that is stated to be independent between "
    "flights and processes, which the first flights do not contradict. A flight that is re-run, also for its history, "
    "has another draw.",
    Repeatability.NOISE: "The simulator gives other numbers of the same inputs. Nothing shows that its flights are "
    "independent of each other: workers may share one stream of random numbers. No verdict is given. Seed its noise "
    "from an input with `seed: true`, or state by `simulator: {repeatable: no}` that the noise is independent between "
    "flights and processes.",
    Repeatability.SHARED: "The simulator is stated to draw independent noise (`repeatable: no`), but new processes "
    "draw the same noise: flights of different workers are copies. No verdict is given. Seed its noise from an input "
    "with `seed: true`.",
}  # fmt: skip


def weakest(found: Iterable[Repeatability | None]) -> Repeatability | None:
    """Return the value that outweighs the others; None if nothing is known."""
    order = list(Repeatability)
    return max((each for each in found if each is not None), key=order.index, default=None)


def relative_difference(a: Floats, b: Floats) -> Floats:
    """Return ``|a - b|`` in units of the larger value; 0 for equal values and two NaN, infinite for one NaN."""
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(a - b) / np.maximum(np.abs(a), np.abs(b))
    return np.where(same, 0.0, np.nan_to_num(off, nan=np.inf))
