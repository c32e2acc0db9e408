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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Mask, Singles
from abhv_mc.flight.plan import FlightBlock, Recording
from abhv_mc.folder.arrays import read_array, write_array
from abhv_mc.folder.flights import DamagedFileError, parse_block_name
from abhv_mc.folder.histories import EnvelopeTable
from abhv_mc.folder.layout import write_whole
from abhv_mc.io.input_error import InputError
from abhv_mc.statistics.bands import QUANTILES, band_quantiles

ENVELOPE_FLIGHTS = 4096
_SLAB = 4_000_000  # values sorted at once
_MORE = 4  # rows of a block's file that are no flight's


@dataclass(frozen=True)
class Cells:
    """What envelopes are made of: the channels at the recorded times."""

    channels: tuple[str, ...]
    columns: tuple[int, ...]  # of the plan's channels
    every: int  # control ticks between recorded times
    times: Floats | None = None  # of every block; None: a block has those that its flights last
    points: int = 1  # of unknowns; flight k flies at point k % points

    @property
    def recording(self) -> Recording:
        """What flights record for them."""
        return Recording(self.every, self.columns, extremes=True)


class Collector:
    """Keeps every value of one controller in one file per block until the campaign is complete.

    A file has a row [cell] for each flight, then the smallest and the largest values, and the times in two rows.
    """

    def __init__(self, folder: Path, controller: str, flown: Mask, cells: Cells) -> None:
        """``flown`` [flight]: which of the campaign's flights have their row."""
        self._folder, self._controller, self._cells = folder / "blocks", controller, cells
        self.recorded = cells.recording
        self.covered = (
            np.arange(len(flown)) >= ENVELOPE_FLIGHTS
        )  # [flight] which are in, or not wanted
        self._blocks: dict[
            Path, tuple[int, int, Floats]
        ] = {}  # those that are whole, with their flights and times
        for path in self._folder.glob(f"{controller}-*.npy"):
            with contextlib.suppress(DamagedFileError):
                name, first, stop = parse_block_name(path)
                values = read_array(path) if name == controller else None
                if (
                    values is None
                    or stop > min(len(flown), ENVELOPE_FLIGHTS)
                    or not self._is_block(values, stop - first)
                ):
                    continue
                self.covered[first:stop] |= flown[first:stop]
                self._blocks[path] = first, stop, _times_of(values, len(cells.channels))

    def _is_block(self, values: NDArray[Any], flights: int) -> bool:
        width, times = len(self._cells.channels), self._cells.times
        whole = values.dtype == np.float32 and values.ndim == 2 and len(values) == flights + _MORE
        return whole and (
            values.shape[1] % width == 0 if times is None else values.shape[1] == width * len(times)
        )

    def add(self, first: int, block: FlightBlock) -> None:
        flights, times, channels = block.history.shape
        stop, cells = first + flights, times * channels
        self.covered[first:stop] = True
        if cells:
            path = self._folder / f"{self._controller}-{first:09d}-{stop:09d}.npy"
            clock = np.repeat(block.times, channels).view(np.float32).reshape(2, cells)
            write_array(
                path,
                block.history.reshape(-1, cells),
                np.stack(block.extremes).reshape(2, cells),
                clock,
            )
            self._blocks[path] = first, stop, block.times

    @property
    def times(self) -> Floats:
        """Those at which any flight was, s."""
        if self._cells.times is not None:
            return self._cells.times
        return np.unique(
            np.concatenate([np.empty(0), *(times for *_, times in self._blocks.values())])
        )

    def table(self, times: Floats) -> EnvelopeTable:
        """The envelopes at ``times``, which are those of all controllers."""
        blocks, taken, numbers = [], np.zeros(len(self.covered), bool), []
        shape = len(times), len(self._cells.channels)
        cells = shape[0] * shape[1]
        seen = np.full((2, cells), np.nan, np.float32)
        for path, (first, stop, clock) in sorted(self._blocks.items()):
            block = read_array(path)
            if block is None:
                raise InputError(
                    path, "damaged or deleted meanwhile", "the same command, which makes it anew"
                )
            values, ends = block[:-_MORE], block[-_MORE:-2]
            begin = shape[1] * int(np.searchsorted(times, clock[0]))
            own = slice(begin, begin + block.shape[1])
            seen[:, own] = np.fmin(seen[0, own], ends[0]), np.fmax(seen[1, own], ends[1])
            fresh = ~taken[first:stop] & _computed(
                values
            )  # blocks of two sizes may overlap after a resume
            taken[first:stop] |= fresh
            blocks.append((values, fresh, begin))
            numbers.append(np.arange(first, stop)[fresh])
        total = int(taken.sum())
        points = np.concatenate(numbers) % self._cells.points if numbers else np.empty(0, np.int64)
        count, quantiles = np.zeros(cells, np.int64), np.full((2, len(QUANTILES), cells), np.nan)
        width = max(1, _SLAB // max(1, total))
        for start in range(0, cells, width):
            slab = slice(start, min(start + width, cells))
            values, at = np.full((slab.stop - start, total), np.nan, np.float32), 0
            for block, fresh, begin in blocks:
                held = block[fresh, max(start - begin, 0) : max(slab.stop - begin, 0)].T
                top = max(begin - start, 0)
                values[top : top + len(held), at : at + held.shape[1]] = held
                at += held.shape[1]
            count[slab] = np.sum(~np.isnan(values), axis=1)
            for point in range(self._cells.points):
                at_point = values if self._cells.points == 1 else values[:, points == point]
                found = band_quantiles(at_point, np.sum(~np.isnan(at_point), axis=1))
                quantiles[0, :, slab] = np.fmin(quantiles[0, :, slab], found)
                quantiles[1, :, slab] = np.fmax(quantiles[1, :, slab], found)
        least, most = quantiles.reshape((2, -1, *shape))
        return EnvelopeTable(count.reshape(shape), *_ends(seen, count, shape), least, most)

    def finish(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        with contextlib.suppress(OSError):  # it holds another controller's
            self._folder.parent.rmdir()


def _times_of(block: Singles, channels: int) -> Floats:
    """The times [time] s of a block's file."""
    return np.ascontiguousarray(block[-2:]).reshape(-1).view(np.float64)[::channels]


def _ends(seen: Singles, count: NDArray[np.int64], shape: tuple[int, int]) -> tuple[Floats, Floats]:
    """Smallest and largest values ``[time, channel]``; none where no flight flies any more."""
    low, high = (
        np.where(count > 0, side.astype(np.float64), np.nan).reshape(shape) for side in seen
    )
    return low, high


def _computed(values: Singles) -> Mask:
    """Which flights ``[flight, cell]`` the machine could compute: every one has a value."""
    return np.asarray((~np.isnan(values)).any(axis=1))


def merge_states(folders: Sequence[Path], target: Path) -> None:
    """Copy the values that the shards of a campaign have kept; what is missing is flown again."""
    for folder in folders:
        for path in (folder / "blocks").glob("*.npy"):
            write_whole(target / "blocks" / path.name, partial(shutil.copyfile, path))
