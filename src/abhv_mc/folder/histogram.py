"""Envelopes of any number of flights in fixed memory: integer histograms, and the extreme values themselves.

A cell is one channel at one recorded time. Its bins are fixed before the campaign flies, from pilot flights that
every run of the campaign flies alike. Counts and the ``KEPT`` smallest and largest values do not depend on the order
in which flights come, so neither does any number made of them.
"""

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Ints, Singles
from abhv_mc.folder.envelopes import QUANTILES, EnvelopeTable
from abhv_mc.jit import kernel

BINS = 128
KEPT = 137  # extreme values at each end: the 0.135 % quantile of 1e5 flights stands on the 136th
_TILE = 64  # cells whose counts fit a first-level cache
_ABREAST = 64  # flights added at once
_SPARE = 192  # room for extreme values not yet sorted; at least _ABREAST, and KEPT to merge
_ROUNDING = 1.0001  # a value within rounding of a bin's edge may count in the next bin
_PIECE = 1024  # cells sorted at once
MARGIN = 0.5  # bins reach beyond the pilot flights by this share of their range, at each end


@kernel
def _count(
    history: Singles,
    low: Singles,
    inverse_width: Singles,
    counts: NDArray[np.uint32],
    ends: Singles,
    filled: Ints,
    threshold: Singles,
) -> None:
    """Add ``history[flight, cell]``; ``ends[side, cell]`` collects what lies beyond ``threshold[side, cell]``.

    Side 0 holds large values, side 1 the negated small ones. Cells come tile by tile, so that a tile's counts stay
    in the cache while all flights pass.
    """
    cells, zero, last = low.size, np.float32(0.0), np.float32(counts.shape[1] - 1)
    for tile in range(0, cells, _TILE):
        for flight in range(history.shape[0]):
            row = history[flight, tile : tile + _TILE]
            edge, scale = low[tile : tile + _TILE], inverse_width[tile : tile + _TILE]
            count = counts[tile : tile + _TILE]
            for i in range(row.size):
                x = row[i]
                if np.isnan(x):
                    continue
                place = (x - edge[i]) * scale[i]
                place = zero if place < zero else place
                place = last if place > last else place
                count[i, np.int32(place)] += 1
            for i in range(row.size):
                x, cell = row[i], tile + i
                if x > threshold[0, cell]:
                    ends[0, cell, filled[0, cell]] = x
                    filled[0, cell] += 1
                if -x > threshold[1, cell]:
                    ends[1, cell, filled[1, cell]] = -x
                    filled[1, cell] += 1


@kernel
def _merge(ours: Singles, theirs: Singles, best: Singles, threshold: Singles) -> None:
    """The largest of two falling rows of each side and cell into ``best``, and the smallest of them."""
    kept = ours.shape[2]
    for side in range(ours.shape[0]):
        for cell in range(ours.shape[1]):
            a, b, out = ours[side, cell], theirs[side, cell], best[side, cell]
            i = j = 0
            for k in range(kept):
                first = a[i] >= b[j]
                out[k] = a[i] if first else b[j]
                i += 1 if first else 0
                j += 0 if first else 1
            threshold[side, cell] = out[kept - 1]


class Histograms:
    """Counts and extreme values of every cell of one controller."""

    def __init__(self, low: Singles, width: Singles) -> None:
        cells = low.size
        self.low = low  # [cell] lower edge of the first bin
        self.width = width  # [cell] of a bin
        self.counts = np.zeros((cells, BINS), np.uint32)  # the first and the last bin are open
        self._ends = np.full((2, cells, KEPT + _SPARE), -np.inf, np.float32)
        self._filled = np.zeros((2, cells), np.int64)
        self._threshold = np.full((2, cells), -np.inf, np.float32)
        self._sorted = True  # what is kept falls, and nothing follows it

    @property
    def total(self) -> NDArray[np.int64]:
        """Values counted ``[cell]``."""
        return self.counts.sum(axis=1, dtype=np.int64)

    def add(self, history: Singles) -> None:
        """Add flights ``history[flight, cell]``; not-a-number is no value."""
        for first in range(0, len(history), _ABREAST):
            if self._filled.max(initial=0) > KEPT + _SPARE - _ABREAST:
                self._compact()
            self._sorted = False
            block = np.ascontiguousarray(history[first : first + _ABREAST])
            _count(
                block, self.low, np.float32(1.0) / self.width, self.counts,
                self._ends, self._filled, self._threshold,
            )  # fmt: skip

    def tails(self) -> Singles:
        """The largest values and the negated smallest ones ``[side, cell, KEPT]``, falling; -inf if missing."""
        self._compact()
        return self._ends[:, :, :KEPT].copy()

    def merge(self, counts: NDArray[np.uint32], extremes: Singles) -> None:
        """Add what another one of the same bins has counted."""
        self.counts += counts
        _merge(self.tails(), extremes, self._ends, self._threshold)
        self._filled[:] = KEPT

    def _compact(self) -> None:
        """Keep the KEPT best of each side and cell."""
        if self._sorted:
            return
        self._sorted = True
        for side in range(2):
            for first in range(0, self.low.size, _PIECE):
                cells = slice(first, first + _PIECE)
                best = np.sort(np.partition(self._ends[side, cells], _SPARE, axis=1)[:, _SPARE:], axis=1)[:, ::-1]
                self._ends[side, cells, :KEPT] = best  # falling: what is missing comes last
                self._ends[side, cells, KEPT:] = -np.inf
                self._threshold[side, cells] = best[:, -1]
        np.minimum(self._filled, KEPT, out=self._filled)

    def table(self, times: int, channels: int) -> EnvelopeTable:
        """Envelopes ``[time, channel]``; cells are ordered so."""
        cells = self.low.size
        largest, negated = self.tails().astype(np.float64)
        smallest = -negated  # rising from the minimum; ``largest`` falls from the maximum
        quantiles, error = np.full((len(QUANTILES), cells), np.nan), np.zeros(cells)
        below = np.cumsum(self.counts, axis=1, dtype=np.int64)
        total = self.total
        flown = np.flatnonzero(total)
        for q, probability in enumerate(QUANTILES):
            rank = probability * (total[flown] - 1)
            floor = np.floor(rank).astype(np.int64)
            lower, lower_error = self._order_statistic(flown, floor, smallest, largest, below)
            above = np.minimum(floor + 1, total[flown] - 1)
            upper, upper_error = self._order_statistic(flown, above, smallest, largest, below)
            quantiles[q, flown] = lower + (upper - lower) * (rank - floor)
            error[flown] = np.maximum(error[flown], np.maximum(lower_error, upper_error))
        low, high = (np.where(total > 0, ends[:, 0], np.nan) for ends in (smallest, largest))
        grid = (times, channels)
        return EnvelopeTable(
            total.reshape(grid), low.reshape(grid), high.reshape(grid),
            quantiles.reshape((-1, *grid)), error.reshape(grid),
        )  # fmt: skip

    def _order_statistic(
        self, cells: Ints, k: Ints, smallest: Floats, largest: Floats, below: Ints
    ) -> tuple[Floats, Floats]:
        """The k-th value (from 0) of each cell and a bound on its error."""
        total = below[cells, -1]
        value, error = np.empty(len(cells)), np.zeros(len(cells))
        from_low, from_high = k < KEPT, total - 1 - k < KEPT
        value[from_low] = smallest[cells[from_low], k[from_low]]
        high = from_high & ~from_low
        value[high] = largest[cells[high], (total - 1 - k)[high]]
        rest = np.flatnonzero(~(from_low | from_high))
        if rest.size:
            cell, rank = cells[rest], k[rest]
            place = np.argmax(below[cell] > rank[:, None], axis=1)
            inside = self.counts[cell, place]
            before = below[cell, place] - inside
            # An open bin ends at the kept values, which the wanted one lies between.
            width = self.width[cell].astype(np.float64)
            left = self.low[cell] + place * width
            right = left + width
            left = np.where(place == 0, -np.inf, left)
            right = np.where(place == BINS - 1, np.inf, right)
            left = np.maximum(left, smallest[cell, KEPT - 1])
            right = np.minimum(right, largest[cell, KEPT - 1])
            value[rest] = left + (right - left) * (rank - before + 0.5) / inside
            error[rest] = (right - left) * _ROUNDING
        return value, error


def make_bins(pilot: Singles) -> tuple[Singles, Singles]:
    """Lower edge and bin width ``[cell]`` from pilot flights ``[flight, cell]``."""
    values = pilot.astype(np.float64)
    empty = np.all(np.isnan(values), axis=0)
    low = np.where(empty, 0.0, np.min(values, axis=0, initial=np.inf, where=~np.isnan(values)))
    high = np.where(empty, 0.0, np.max(values, axis=0, initial=-np.inf, where=~np.isnan(values)))
    reach = np.maximum(MARGIN * (high - low), 1e-6 * np.maximum(1.0, np.abs(low)))
    low, high = low - reach, high + reach
    return low.astype(np.float32), ((high - low) / BINS).astype(np.float32)
