"""When a campaign that stops when proven stops: at the first of its looks at which every requirement is settled.

Flights fly look by look, so none beyond the stopping look is ever kept, and the look depends on the flights alone:
not on workers, blocks, order or interruptions.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abhv_mc.statistics.sequential import make_sequential_plan, stopping_look

Mask = NDArray[np.bool_]


def find_goal(
    looks: Sequence[int],
    done: Mapping[str, Mask],
    missed: Sequence[Mask],
    demands: Sequence[tuple[float, float]],
    untried: Mask | None = None,
) -> int:
    """Number of flights to have: up to the first look that is not complete, or that settles everything.

    ``done`` [flight] of each controller; ``missed`` [flight] of each requirement on each controller that it binds,
    beside its (probability, consumer's risk) in ``demands``. A look with ``untried`` [flight] flights, which could not
    be computed and were not tried again, is not complete.
    """
    plans = [make_sequential_plan(tuple(looks), *demand) for demand in demands]
    complete = int(min(np.argmin(np.append(mask, False)) for mask in done.values()))
    if untried is not None and untried.any():
        complete = min(complete, int(np.argmax(untried)))
    for look in looks:
        if look > complete:
            return look
        if stopping_look([flags[:look] for flags in missed], plans) is not None:
            return look
    return looks[-1]
