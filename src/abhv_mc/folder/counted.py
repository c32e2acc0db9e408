"""Blocks of many flights that come back as their rows and one merged state of the envelopes.

Where histograms count, samples need not travel: 1.6 kB a flight of a block of 8192, where its samples have 33 kB.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Singles
from abhv_mc.flight.plan import FlightBlock, FlightPlan, Recording, join_blocks
from abhv_mc.folder.histogram import Histograms


class Counting(NamedTuple):
    """What is counted of flights."""

    recording: Recording  # of each batch
    low: Singles  # [cell] bins, see abhv_mc.folder.histogram.make_bins
    width: Singles  # [cell]
    batch: int  # flights that are flown at once


@dataclass(frozen=True, kw_only=True)
class CountedBlock(FlightBlock):
    """Flights without their samples, which are counted."""

    counts: NDArray[np.uint32]  # [cell, bin]
    ends: Singles  # [side, cell, kept] see Histograms.extremes


def count_flights(
    fly: Callable[[FlightPlan, Floats, Recording], FlightBlock],
    plan: FlightPlan,
    parameters: Floats,
    counting: Counting,
    begin: Callable[[], None] = lambda: None,
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
    return CountedBlock(**parts, counts=histograms.counts, ends=histograms.extremes())
