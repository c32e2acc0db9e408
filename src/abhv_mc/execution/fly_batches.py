"""What every worker does with a block: fly it in calls of so many flights as fill the lanes, and join these."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from abhv_mc.array_types import Floats
from abhv_mc.flight.plan import FlightBlock, FlightPlan, join_blocks

if TYPE_CHECKING:  # which a worker process need not import
    from abhv_mc.interfaces import Fly, Recorded

AT_ONCE = 256  # flights of one call: enough for every lane, few enough to lose


def fly_in_batches(
    fly: "Fly",
    plan: FlightPlan,
    parameters: Floats,
    recorded: "Recorded",
    begin: Callable[[], None] = lambda: None,
) -> FlightBlock:
    """Fly all rows; ``begin`` is called before each call of ``fly``."""
    blocks = []
    for first in range(0, max(1, len(parameters)), AT_ONCE):
        begin()
        blocks.append(fly(plan, parameters[first : first + AT_ONCE], recorded))
    return blocks[0] if len(blocks) == 1 else join_blocks(blocks)
