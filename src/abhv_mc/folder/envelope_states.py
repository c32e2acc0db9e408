"""Stored values from which the time-history envelopes of a controller are computed.

Bands and extremes are exact for flights 0 to ``ENVELOPE_FLIGHTS`` - 1, in any order of computation;
later flights are not recorded. The values are stored until the campaign is complete, so that a
killed run can resume.
"""

import contextlib
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Mask
from abhv_mc.flights.blocks import FlightBlock, Recording
from abhv_mc.folder.arrays import read_array, write_array
from abhv_mc.folder.flights import DamagedFileError, parse_block_name
from abhv_mc.folder.histories import EnvelopeTable
from abhv_mc.folder.layout import write_whole
from abhv_mc.io.messages import InputError
from abhv_mc.statistics.bands import QUANTILES, band_quantiles
from abhv_mc.statistics.circular import align_flights

ENVELOPE_FLIGHTS = 4096
_EXTRA_ROWS = 4  # number of rows after the flights in a block's file
_SIDES = (np.fmin, np.fmax)


@dataclass(frozen=True)
class Cells:
    """Channels and times of envelopes; a cell is one channel at one time."""

    channels: tuple[str, ...]
    columns: tuple[int, ...]  # indices of these channels among the channels of the plan
    every: int  # number of control ticks between recorded times
    times: Floats | None = None  # times of all blocks, or None if each block has its own times
    points: int = 1  # number of points of the unknowns; flight k uses point k % points
    # period of each channel, 0 if it is not circular
    periods: Mapping[str, float] = field(default_factory=dict)

    @property
    def recording(self) -> Recording:
        """Recording settings for the flights."""
        return Recording(self.every, self.columns, extremes=True)


class Collector:
    """Values of one controller, stored in one file per block until the campaign is complete.

    A file has a row [cell] for each flight, then a row with the smallest values, a row with the
    largest values, and two rows with the times.
    """

    def __init__(self, folder: Path, controller: str, flown: Mask, cells: Cells) -> None:
        """Find the stored blocks; ``flown`` is the mask [flight] of the stored flights."""
        self._folder, self._controller, self._cells = folder / "blocks", controller, cells
        self.recorded = cells.recording
        # [flight] true if values are stored or not needed
        self.covered = np.arange(len(flown)) >= ENVELOPE_FLIGHTS
        # file -> (first flight, stop, times) of each intact block
        self._blocks = {}
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
                times = np.ascontiguousarray(values[-2:]).reshape(-1).view(np.float64)
                self._blocks[path] = first, stop, times[:: len(cells.channels)]

    def _is_block(self, values: NDArray[Any], flights: int) -> bool:
        width, times = len(self._cells.channels), self._cells.times
        rows = flights + _EXTRA_ROWS
        is_complete = values.dtype == np.float32 and values.ndim == 2 and len(values) == rows
        return is_complete and (
            values.shape[1] % width == 0 if times is None else values.shape[1] == width * len(times)
        )

    def add(self, first: int, block: FlightBlock) -> None:
        """Store the recorded values of a block whose first flight is ``first``."""
        flights, times, channels = block.history.shape
        stop, cells = first + flights, times * channels
        self.covered[first:stop] = True
        if cells:
            path = self._folder / f"{self._controller}-{first:09d}-{stop:09d}.npy"
            write_array(
                path,
                block.history.reshape(-1, cells),
                np.stack(block.extremes).reshape(2, cells),
                np.repeat(block.times, channels).view(np.float32).reshape(2, cells),
            )
            self._blocks[path] = first, stop, block.times

    @property
    def times(self) -> Floats:
        """Times [time] at which at least one flight was recorded, s."""
        if self._cells.times is not None:
            return self._cells.times
        return np.unique(
            np.concatenate([np.empty(0), *(times for *_, times in self._blocks.values())])
        )

    def table(self, times: Floats) -> EnvelopeTable:
        """Return the envelopes at ``times``, which all controllers have in common."""
        blocks, covered, numbers = [], np.zeros(len(self.covered), bool), []
        shape = len(times), len(self._cells.channels)
        ends = np.full((2, *shape), np.nan, np.float32)
        for path, (first, stop, clock) in sorted(self._blocks.items()):
            rows = read_array(path)
            if rows is None:
                raise InputError(
                    path,
                    "the file was damaged or deleted during the run",
                    "the same command again, which creates a new file",
                )
            block = rows.reshape(len(rows), -1, shape[1])
            begin = int(np.searchsorted(times, clock[0]))
            end = begin + block.shape[1]
            ends[:, begin:end] = [
                side(*pair)
                for side, *pair in zip(
                    _SIDES, ends[:, begin:end], block[-_EXTRA_ROWS:-2], strict=True
                )
            ]
            # Blocks of different sizes may overlap after a run was resumed.
            values = block[:-_EXTRA_ROWS]
            fresh = ~covered[first:stop] & ~np.isnan(values).all(axis=(1, 2))
            covered[first:stop] |= fresh
            blocks.append((values, fresh, slice(begin, end)))
            numbers.append(np.arange(first, stop)[fresh])
        flights = np.concatenate([np.empty(0, np.int64), *numbers])
        count, quantiles = np.zeros(shape, np.int64), np.full((2, len(QUANTILES), *shape), np.nan)
        for c, channel in enumerate(self._cells.channels):
            values, column = np.full((len(times), len(flights)), np.nan, np.float32), 0
            for block, fresh, span in blocks:
                columns = slice(column, column + int(fresh.sum()))
                values[span, columns] = block[:, :, c][fresh].T
                column = columns.stop
            count[:, c] = np.sum(~np.isnan(values), axis=1)
            if period := self._cells.periods.get(channel):
                values[:] = align_flights(values.T, period).T
                # Blocks reduce extremes across the seam.
                ends[:, :, c] = [side.reduce(values, axis=1, initial=np.nan) for side in _SIDES]
            for point in range(self._cells.points):
                at_point = values[:, flights % self._cells.points == point]
                at_point = band_quantiles(at_point)
                quantiles[..., c] = [
                    side(edge, at_point)
                    for side, edge in zip(_SIDES, quantiles[..., c], strict=True)
                ]
        low, high = np.where(count > 0, ends.astype(np.float64), np.nan)
        return EnvelopeTable(count, low, high, *quantiles)

    def finish(self) -> None:
        """Delete the stored values."""
        shutil.rmtree(self._folder, ignore_errors=True)
        with contextlib.suppress(OSError):  # The folder may contain files of another controller.
            self._folder.parent.rmdir()


def merge_states(folders: Sequence[Path], target: Path) -> None:
    """Copy the stored values of a campaign's shards; later, flights without values are re-run."""
    for folder in folders:
        for path in (folder / "blocks").glob("*.npy"):
            write_whole(target / "blocks" / path.name, partial(shutil.copyfile, path))
