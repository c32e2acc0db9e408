"""Repeatability of a custom simulator, and its effect on the evidence from flights."""

from collections.abc import Iterable
from enum import StrEnum

import numpy as np

from abhv_mc.array_types import Floats

ROUNDING = 1e-9  # largest relative difference between values that count as equal


class Repeatability(StrEnum):
    """Repeatability of a campaign's first flights, in order of increasing precedence."""

    EXACT = "yes"
    ROUNDING = "rounding"
    # The campaign states `repeatable: no`, and the first flights agree with this statement.
    DECLARED = "no, independent noise"
    NOISE = "no"
    SHARED = "no, noise that processes share"

    @property
    def is_evidence(self) -> bool:
        """Return whether flights may count as independent draws."""
        return self not in (Repeatability.NOISE, Repeatability.SHARED)

    @property
    def sentence(self) -> str:
        """Explanatory sentence for the report."""
        return _SENTENCES[self]


_SENTENCES = {
    Repeatability.EXACT: "The first flights gave the same numbers in two new processes, bit for "
    "bit.",
    Repeatability.ROUNDING: "The first flights gave the same numbers in two new processes up to "
    f"rounding (at most {ROUNDING:g} of the value); re-run flights are compared with that "
    "tolerance.",
    Repeatability.DECLARED: (
        "The campaign states (`repeatable: no`) that the simulator draws independent noise for "
        "each flight and process; the first flights do not contradict this statement. Re-run "
        "flights, including re-runs for histories, have different noise."
    ),
    Repeatability.NOISE: (
        "The simulator returns different numbers for the same inputs. It is unknown whether its "
        "flights are independent of each other: workers may share one stream of random numbers. "
        "No verdict is given. Seed the noise from an input with `seed: true`, or state with "
        "`simulator: {repeatable: no}` that the noise is independent between flights and "
        "processes."
    ),
    Repeatability.SHARED: "New processes draw the same noise, although the campaign states "
    "(`repeatable: no`) that the noise is independent: flights of different workers are copies. No "
    "verdict is given. Seed the noise from an input with `seed: true`.",
}


def weakest(values: Iterable[Repeatability | None]) -> Repeatability | None:
    """Return the value that takes precedence, or None if there are no values."""
    order = list(Repeatability)
    return max((value for value in values if value is not None), key=order.index, default=None)


def relative_difference(a: Floats, b: Floats) -> Floats:
    """Return ``|a - b|`` relative to the larger value.

    The result is 0 for equal values or two NaNs, and infinite for one NaN.
    """
    is_equal = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore", divide="ignore"):
        difference = np.abs(a - b) / np.maximum(np.abs(a), np.abs(b))
    return np.where(is_equal, 0.0, np.nan_to_num(difference, nan=np.inf))
