"""Values of given ranks, exact, in a quarter of the time that sorting all of them takes."""

import numpy as np

from abhv_mc.array_types import Ints, Singles
from abhv_mc.kernel.jit import kernel

BINS = 1024


@kernel
def select_ranks(values: Singles, ranks: Ints, found: Singles) -> None:
    """The value of each rank (0: the smallest) ``ranks[cell, rank]`` among ``values[cell, flight]`` into ``found``.

    Not-a-number counts as no value; ranks are below the number of values, and nothing is written where there is none.
    A count in bins of equal width finds the bin of a rank; only that bin's values are sorted. Values that rounding
    moves to the next bin change nothing, as it keeps their order.
    """
    size = values.shape[1]
    row, inside, place = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.int16)
    for cell in range(values.shape[0]):
        count = 0
        low, high = np.float32(np.inf), np.float32(-np.inf)
        for flight in range(size):
            x = values[cell, flight]
            if not np.isnan(x):
                row[count] = x
                count += 1
                low, high = min(low, x), max(high, x)
        if count == 0:
            continue
        scale = np.float32(BINS - 1) / (high - low)
        bins = np.zeros(BINS + 1, np.int64)
        if high > low and np.isfinite(scale) and np.isfinite(high - low):
            for i in range(count):
                place[i] = np.int16((row[i] - low) * scale)
        else:  # all alike, or infinite: one bin
            place[:count] = 0
        for i in range(count):
            bins[place[i]] += 1
        bin_ = below = 0
        sorted_ = -1
        values_there = inside[:0]
        for k in range(ranks.shape[1]):
            rank = ranks[cell, k]
            if rank < below:
                bin_ = below = 0
            while below + bins[bin_] <= rank:
                below += bins[bin_]
                bin_ += 1
            if bin_ != sorted_:
                there = 0
                for i in range(count):
                    if place[i] == bin_:
                        inside[there] = row[i]
                        there += 1
                values_there, sorted_ = np.sort(inside[:there]), bin_
            found[cell, k] = values_there[rank - below]
