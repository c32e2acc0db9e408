"""Failed flights grouped by what they fail with: as few sets of dispersions as explain them all."""

from collections.abc import Sequence
from dataclasses import dataclass

from abhv_mc.analysis.shrink import Shrunk
from abhv_mc.array_types import Mask

MOST_CAUSES = 3  # of a set that explains a flight, none of which can be left out; larger ones say little


@dataclass(frozen=True)
class Cause:
    """A set of inputs, each on one side, and the failures (numbers in the list given) that it is enough for."""

    inputs: tuple[int, ...]
    high: tuple[bool, ...]  # on which side of nominal each is
    failures: tuple[int, ...]


def group_failures(found: Sequence[Shrunk | None], high: Mask) -> tuple[list[Cause], list[int]]:
    """Causes, those of most failures first, and the failures that no small set explains.

    ``high`` says which inputs lie above nominal, ``[failure, input]``: too much of one is another cause than too
    little. Where several sets are enough for a failure it goes to the one that explains most failures (greedy
    set cover): a set that is the smallest for one flight alone is often a border case of another's cause.
    """
    sets = {
        failure: {
            tuple((i, bool(high[failure, i])) for i in members)
            for members in shrunk.sets
            if 0 < len(members) <= MOST_CAUSES
        }
        for failure, shrunk in enumerate(found)
        if shrunk is not None
    }
    left = {failure for failure, members in sets.items() if members}
    causes = []
    while left:
        explained: dict[tuple[tuple[int, bool], ...], list[int]] = {}
        for failure in sorted(left):
            for members in sets[failure]:
                explained.setdefault(members, []).append(failure)
        best = min(explained, key=lambda members: (-len(explained[members]), len(members), members))
        inputs, sides = zip(*best, strict=True)
        causes.append(Cause(inputs, sides, tuple(explained[best])))
        left -= set(explained[best])
    told = {failure for cause in causes for failure in cause.failures}
    return causes, [failure for failure in range(len(found)) if failure not in told]
