"""Envelopes of a controller: every recorded value of the first flights is kept, through a kill, until all are there.

Bands and extremes are of flights 0 to ``ENVELOPE_FLIGHTS`` - 1, exact, whatever the order in which they land; later
flights record nothing. Their 0.135 % line is known as well as 4,096 flights can know it.
"""

import contextlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Mask, Singles
from abhv_mc.flight.plan import FlightBlock, Recording
from abhv_mc.folder.arrays import read_array, write_array
from abhv_mc.folder.envelopes import QUANTILES, EnvelopeTable
from abhv_mc.folder.flights import DamagedFileError, parse_block_name
from abhv_mc.folder.layout import write_whole
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.numerics.order_statistics import select_ranks

ENVELOPE_FLIGHTS = 4096
_SLAB = 4_000_000  # values sorted at once


@dataclass(frozen=True)
class Cells:
    """What envelopes are made of: the channels at the recorded times."""

    channels: tuple[str, ...]
    columns: tuple[int, ...]  # of CHANNELS
    times: NDArray[np.float64]
    every: int  # control ticks between recorded times
    points: int = 1  # of unknowns; flight k flies at point k % points

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.times), len(self.channels)

    @property
    def count(self) -> int:
        return len(self.times) * len(self.channels)

    @property
    def recording(self) -> Recording:
        """What flights record for them."""
        return Recording(self.every, self.columns, extremes=True)

    def flatten(self, history: Singles) -> Singles:
        """``[flight, cell]`` of recorded values ``[flight, time, channel]``."""
        return history.reshape(len(history), self.count)

    def extremes(self, block: FlightBlock) -> Singles:
        """Smallest and largest values ``[side, cell]`` of a block, of every tick."""
        return self.flatten(np.stack(block.extremes))


class Collector:
    """Keeps every value of one controller in one file per block until the campaign is complete."""

    def __init__(self, folder: Path, controller: str, flights: int, cells: Cells) -> None:
        self._folder, self._controller, self._cells = folder / "blocks", controller, cells
        self.recorded = cells.recording
        self.covered = np.arange(flights) >= ENVELOPE_FLIGHTS  # [flight] which are in, or not wanted
        self._blocks: dict[Path, tuple[int, int]] = {}  # those that are whole, with their flights
        for path in self._folder.glob(f"{controller}-*.npy"):
            with contextlib.suppress(DamagedFileError):
                name, first, stop = parse_block_name(path)
                values = read_array(path) if name == controller else None
                shape = stop - first + 2, cells.count
                last = min(flights, ENVELOPE_FLIGHTS)
                if values is not None and values.dtype == np.float32 and values.shape == shape and stop <= last:
                    self.covered[first:stop] |= _computed(values[:-2])
                    self._blocks[path] = first, stop

    def add(self, first: int, block: FlightBlock) -> None:
        history = self._cells.flatten(block.history)
        path = self._folder / f"{self._controller}-{first:09d}-{first + len(history):09d}.npy"
        write_array(path, history, self._cells.extremes(block))
        self._blocks[path] = first, first + len(history)
        self.covered[first : first + len(history)] = True

    def table(self) -> EnvelopeTable:
        blocks, taken, numbers = [], np.zeros(len(self.covered), bool), []
        seen = _nothing_seen(self._cells.count)
        for path, (first, stop) in sorted(self._blocks.items()):
            block = read_array(path)
            if block is None:
                raise InputError(path, "damaged or deleted meanwhile", "the same command, which makes it anew")
            values = block[:-2]
            seen = _widen(seen, block[-2:])
            fresh = ~taken[first:stop] & _computed(values)  # blocks of two sizes may overlap after a resume
            taken[first:stop] |= fresh
            blocks.append((values, fresh))
            numbers.append(np.arange(first, stop)[fresh])
        cells, total = self._cells.count, int(taken.sum())
        points = np.concatenate(numbers) % self._cells.points if numbers else np.empty(0, np.int64)
        count, quantiles = np.zeros(cells, np.int64), np.full((2, len(QUANTILES), cells), np.nan)
        width = max(1, _SLAB // max(1, total))
        for start in range(0, cells, width):
            slab = slice(start, min(start + width, cells))
            values = np.empty((slab.stop - start, total), np.float32)
            np.concatenate([block[fresh, slab].T for block, fresh in blocks], axis=1, out=values)
            count[slab] = np.sum(~np.isnan(values), axis=1)
            for point in range(self._cells.points):
                at_point = values if self._cells.points == 1 else values[:, points == point]
                found = _quantiles(at_point, np.sum(~np.isnan(at_point), axis=1))
                quantiles[0, :, slab] = np.fmin(quantiles[0, :, slab], found)
                quantiles[1, :, slab] = np.fmax(quantiles[1, :, slab], found)
        shape = self._cells.shape
        least, most = quantiles.reshape((2, -1, *shape))
        return EnvelopeTable(count.reshape(shape), *_ends(seen, count, shape), least, most)

    def finish(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        with contextlib.suppress(OSError):  # it holds another controller's
            self._folder.parent.rmdir()


def _quantiles(values: Singles, count: NDArray[np.int64]) -> Floats:
    """``[quantile, cell]`` of ``values[cell, flight]``, of which ``count[cell]`` are numbers; nan where none is."""
    ranks = np.array(QUANTILES)[:, None] * np.maximum(count - 1, 0)
    floor = np.floor(ranks).astype(np.int64)
    pairs = np.stack([floor, np.minimum(floor + 1, np.maximum(count - 1, 0))], axis=1)
    found = np.full((len(count), 2 * len(QUANTILES)), np.nan, np.float32)
    select_ranks(values, np.ascontiguousarray(pairs.reshape(-1, len(count)).T), found)
    lower, upper = found[:, ::2].T.astype(np.float64), found[:, 1::2].T
    return np.asarray(lower + (upper - lower) * (ranks - floor))


def _nothing_seen(cells: int) -> Singles:
    return np.full((2, cells), np.nan, np.float32)


def _widen(seen: Singles, extremes: Singles) -> Singles:
    """The smaller of the smallest and the larger of the largest values ``[side, cell]``."""
    return np.stack([np.fmin(seen[0], extremes[0]), np.fmax(seen[1], extremes[1])])


def _ends(seen: Singles, count: NDArray[np.int64], shape: tuple[int, int]) -> tuple[Floats, Floats]:
    """Smallest and largest values ``[time, channel]``; none where no flight flies any more."""
    low, high = (np.where(count > 0, side.astype(np.float64), np.nan).reshape(shape) for side in seen)
    return low, high


def _computed(values: Singles) -> Mask:
    """Which flights ``[flight, cell]`` the machine could compute: every one has a value at its start."""
    return ~np.isnan(values[:, 0])


def merge_states(folders: Sequence[Path], target: Path) -> None:
    """Copy the values that the shards of a campaign have kept; what is missing is flown again."""
    for folder in folders:
        for path in (folder / "blocks").glob("*.npy"):
            write_whole(target / "blocks" / path.name, partial(shutil.copyfile, path))
