"""Blocks of many flights that come back as their rows and one merged state of the envelopes.

Where histograms count, samples need not travel: 1.6 kB a flight of a block of 8192, where its samples have 33 kB.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Singles
from abhv_mc.flight.plan import FlightBlock, Recording


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
    ends: Singles  # [side, cell, kept] see Histograms.tails
