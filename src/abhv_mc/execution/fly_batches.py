"""What every worker does with flights: fly them in one call, or in batches of which the envelopes are counted."""

from collections.abc import Callable
from dataclasses import replace

from abhv_mc.array_types import Floats
from abhv_mc.flight.plan import FlightBlock, FlightPlan, Recording, join_blocks
from abhv_mc.folder.counted import CountedBlock, Counting
from abhv_mc.folder.histogram import Histograms

Recorded = Recording | int | None  # as flight.fly takes it
ToRecord = Counting | Recorded
Fly = Callable[[FlightPlan, Floats, Recorded], FlightBlock]  # in one call
FlyBlocks = Callable[[FlightPlan, Floats, ToRecord], FlightBlock]  # by whoever flies blocks


def fly_recorded(
    fly: Fly, plan: FlightPlan, parameters: Floats, recorded: ToRecord, begin: Callable[[], None] = lambda: None
) -> FlightBlock:
    """What every worker does; ``begin`` is called before each call of ``fly``."""
    if isinstance(recorded, Counting):
        return fly_counted(fly, plan, parameters, recorded, begin)
    begin()
    return fly(plan, parameters, recorded)


def fly_counted(
    fly: Fly, plan: FlightPlan, parameters: Floats, counting: Counting, begin: Callable[[], None] = lambda: None
) -> CountedBlock:
    """Fly in batches and count each; ``begin`` is called before a batch flies."""
    histograms, blocks = Histograms(counting.low, counting.width), []
    for first in range(0, len(parameters), counting.batch):
        begin()
        flown = fly(plan, parameters[first : first + counting.batch], counting.recording)
        history = flown.history.reshape(len(flown.history), -1)
        histograms.add(history)
        low, high = flown.extremes
        blocks.append(replace(flown, history=flown.history[:, :0], low=low, high=high))
    whole = join_blocks(blocks)
    parts = {name: getattr(whole, name) for name in FlightBlock.__dataclass_fields__}
    return CountedBlock(**parts, counts=histograms.counts, ends=histograms.tails())


def at_once(parameters: Floats, recorded: ToRecord) -> int:
    """Flights of one call of ``fly``."""
    return min(len(parameters), recorded.batch) if isinstance(recorded, Counting) else len(parameters)
