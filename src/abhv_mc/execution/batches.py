"""Simulation of a block of flights in batches that fill the kernel's vector lanes."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from abhv_mc.array_types import Floats
from abhv_mc.flights.blocks import FlightBlock, join_blocks

if TYPE_CHECKING:  # Worker processes do not import modules that only annotations need.
    from abhv_mc.interfaces import Fly, Recorded

# number of flights per call: large enough to fill all lanes, small enough to lose little in a crash
BATCH_FLIGHTS = 256


def fly_in_batches(
    fly: "Fly",
    plan: Any,
    parameters: Floats,
    recorded: "Recorded",
    begin: Callable[[], None] = lambda: None,
) -> FlightBlock:
    """Simulate all rows in batches, and call ``begin`` before each batch."""
    blocks = []
    for first in range(0, max(1, len(parameters)), BATCH_FLIGHTS):
        begin()
        blocks.append(fly(plan, parameters[first : first + BATCH_FLIGHTS], recorded))
    return blocks[0] if len(blocks) == 1 else join_blocks(blocks)
