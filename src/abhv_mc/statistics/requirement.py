"""Who fails a requirement: said once, for counting, reports and explanations. Arrays only."""

from abhv_mc.array_types import Floats, Mask


def measured_failures(values: Floats, limit: float, below: bool) -> Mask:
    """Which flights [flight] fail by their metric alone, up to wherever they came; not-a-number fails.

    ``values`` [flight] and ``limit`` are in the same unit; ``below`` says on which side of it they must be.
    """
    return ~(values < limit if below else values > limit)


def requirement_failures(values: Floats, early: Mask, limit: float, below: bool, early_is_failure: bool) -> Mask:
    """Which flights [flight] fail: by their metric, and those that ended ``early`` unless they count as measured."""
    failed = measured_failures(values, limit, below)
    return failed | early if early_is_failure else failed
