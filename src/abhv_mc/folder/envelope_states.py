"""Envelopes over all flights of a controller: collected as blocks land, kept through a kill, the same in any order.

Up to ``EXACT_FLIGHTS`` flights every recorded value is kept on disk until the end and every number is exact. Beyond,
memory stays flat: integer histograms and the extreme values (see :mod:`abhv_mc.folder.histogram`).
"""

import contextlib
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Mask, Singles
from abhv_mc.flight.plan import FlightBlock, Recording
from abhv_mc.folder.arrays import read_array, write_array
from abhv_mc.folder.counted import CountedBlock, Counting
from abhv_mc.folder.envelopes import QUANTILES, EnvelopeTable
from abhv_mc.folder.flights import DamagedFileError, parse_block_name
from abhv_mc.folder.histogram import BINS, KEPT, Histograms, make_bins
from abhv_mc.folder.layout import write_whole
from abhv_mc.folder.order_statistics import select_ranks
from abhv_mc.io.input_error import InputError

EXACT_FLIGHTS = 4096
PILOT_FLIGHTS = 128  # flights 0 .. 127 set the bins
_SLAB = 4_000_000  # values sorted at once

_STATE: dict[str, tuple[type, tuple[int | None, ...]]] = {  # types and shapes; None: one for each cell
    "low": (np.float32, (None,)),
    "width": (np.float32, (None,)),
    "counts": (np.uint32, (None, BINS)),
    "extremes": (np.float32, (2, None, KEPT)),
    "seen": (np.float32, (2, None)),
    "covered": (np.uint8, ()),
    "flights": (np.int64, ()),
}


@dataclass(frozen=True)
class Cells:
    """What envelopes are made of: the channels at the recorded times."""

    channels: tuple[str, ...]
    columns: tuple[int, ...]  # of CHANNELS
    times: NDArray[np.float64]
    every: int  # control ticks between recorded times

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


class Collector(Protocol):
    """Collects the envelopes of one controller."""

    covered: Mask  # [flight] which flights are in

    @property
    def recorded(self) -> Recording | Counting:
        """What flights are to bring."""

    def add(self, first: int, block: FlightBlock) -> None:
        """Add the flights from ``first`` on."""

    def save(self) -> None:
        """Write what a resumed campaign needs."""

    def table(self) -> EnvelopeTable:
        """The envelopes of what was added."""

    def finish(self) -> None:
        """Delete what only an unfinished campaign needs."""


def make_collector(
    folder: Path, controller: str, flights: int, cells: Cells, fly_pilot: Callable[[int], Singles], batch: int
) -> Collector:
    """The collector of a campaign of ``flights`` flights; ``fly_pilot(n)`` flies its first n, ``[flight, cell]``.

    ``batch``: flights that are flown at once where a block of more comes back counted.
    """
    if flights <= EXACT_FLIGHTS:
        return ExactCollector(folder, controller, flights, cells)
    return HistogramCollector(folder, controller, flights, cells, fly_pilot, batch)


class ExactCollector:
    """Keeps every value in one file per block until the campaign is complete."""

    def __init__(self, folder: Path, controller: str, flights: int, cells: Cells) -> None:
        self._folder, self._controller, self._cells = folder / "blocks", controller, cells
        self.recorded = cells.recording
        self.covered = np.zeros(flights, bool)
        self._blocks: dict[Path, tuple[int, int]] = {}  # those that are whole, with their flights
        for path in self._folder.glob(f"{controller}-*.npy"):
            with contextlib.suppress(DamagedFileError):
                name, first, stop = parse_block_name(path)
                values = read_array(path) if name == controller else None
                shape = stop - first + 2, cells.count
                if values is not None and values.dtype == np.float32 and values.shape == shape and stop <= flights:
                    self.covered[first:stop] |= _computed(values[:-2])
                    self._blocks[path] = first, stop

    def add(self, first: int, block: FlightBlock) -> None:
        history = self._cells.flatten(block.history)
        path = self._folder / f"{self._controller}-{first:09d}-{first + len(history):09d}.npy"
        write_array(path, history, self._cells.extremes(block))
        self._blocks[path] = first, first + len(history)
        self.covered[first : first + len(history)] = True

    def save(self) -> None:
        """Every block is saved as it is added."""

    def table(self) -> EnvelopeTable:
        blocks, taken = [], np.zeros(len(self.covered), bool)
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
        cells, total = self._cells.count, int(taken.sum())
        count, quantiles = np.zeros(cells, np.int64), np.full((len(QUANTILES), cells), np.nan)
        width = max(1, _SLAB // max(1, total))
        for start in range(0, cells, width):
            slab = slice(start, min(start + width, cells))
            values = np.empty((slab.stop - start, total), np.float32)
            np.concatenate([block[fresh, slab].T for block, fresh in blocks], axis=1, out=values)
            count[slab] = n = np.sum(~np.isnan(values), axis=1)
            quantiles[:, slab] = _quantiles(values, n)
        shape = self._cells.shape
        return EnvelopeTable(
            count.reshape(shape),
            *_ends(seen, count, shape),
            quantiles.reshape((-1, *shape)),
            np.zeros(shape),
        )

    def finish(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        with contextlib.suppress(OSError):  # it holds another controller's
            self._folder.parent.rmdir()


class HistogramCollector:
    """Counts in memory; the state goes to disk now and then, and a kill costs what came since."""

    def __init__(
        self,
        folder: Path,
        controller: str,
        flights: int,
        cells: Cells,
        fly_pilot: Callable[[int], Singles],
        batch: int,
    ) -> None:
        self._path, self._cells = folder / f"{controller}.npz", cells
        self.covered = np.zeros(flights, bool)
        state = self._load()
        if state is None:
            self._histograms = Histograms(*make_bins(fly_pilot(min(PILOT_FLIGHTS, flights))))
            self._seen = _nothing_seen(cells.count)
            self.save()
        else:
            self._histograms = Histograms(state["low"], state["width"])
            self._histograms.merge(state["counts"], state["extremes"])
            self._seen = state["seen"]
            covered = np.unpackbits(state["covered"], count=int(state["flights"])).astype(bool)
            self.covered[: len(covered)] = covered[:flights]
        self.recorded = Counting(cells.recording, self._histograms.low, self._histograms.width, batch)

    def _load(self) -> dict[str, NDArray] | None:
        state = _read_state(self._path)
        return state if state is not None and state["low"].size == self._cells.count else None

    def add(self, first: int, block: FlightBlock) -> None:
        if not isinstance(block, CountedBlock):
            raise TypeError("a block that was not counted")
        self._histograms.merge(block.counts, block.ends)
        self._seen = _widen(self._seen, self._cells.extremes(block))
        self.covered[first : first + len(block.outcome)] = True

    def save(self) -> None:
        _write_state(self._path, self._histograms, self.covered, self._seen)

    def table(self) -> EnvelopeTable:
        table = self._histograms.table(*self._cells.shape)
        low, high = _ends(self._seen, table.count.ravel(), self._cells.shape)
        return replace(table, low=low, high=high)

    def finish(self) -> None:
        """The state stays: extending or merging campaigns goes on from it."""
        self.save()


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


def _read_state(path: Path) -> dict[str, NDArray] | None:
    """What :func:`_write_state` wrote; None where the file is missing, damaged or not of its kind.

    Compiled code follows the edges of the bins without a look.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            state = {name: stored[name] for name in _STATE}
    except Exception:  # those of numpy and zipfile on damaged files are of many kinds, SyntaxError among them
        return None
    cells, flights = state["low"].size, state["flights"]
    shapes = {name: tuple(cells if n is None else n for n in shape) for name, (_, shape) in _STATE.items()}
    if any(state[name].dtype != kind for name, (kind, _) in _STATE.items()) or flights.shape or flights < 0:
        return None
    shapes["covered"] = ((int(flights) + 7) // 8,)
    if any(state[name].shape != shape for name, shape in shapes.items()):
        return None
    with np.errstate(all="ignore"):
        right = np.isfinite(state["low"]) & (state["width"] > 0.0) & np.isfinite(np.float32(1.0) / state["width"])
    return state if right.all() and np.isfinite(state["width"]).all() else None


def _write_state(path: Path, histograms: Histograms, covered: Mask, seen: Singles) -> None:
    state = {
        "low": histograms.low,
        "width": histograms.width,
        "counts": histograms.counts,
        "extremes": histograms.tails(),
        "seen": seen,
        "covered": np.packbits(covered),
        "flights": np.asarray(len(covered)),
    }

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            np.savez(file, **state)  # type: ignore[arg-type]

    write_whole(path, write)


def merge_states(folders: Sequence[Path], target: Path) -> None:
    """Make one campaign's envelope states in ``target`` of those of its shards, which share no flight.

    Raises ValueError where two do not fit; what is missing or damaged is flown again by whoever goes on from it.
    """
    for folder in folders:
        for path in (folder / "blocks").glob("*.npy"):
            write_whole(target / "blocks" / path.name, partial(shutil.copyfile, path))
    for name in sorted({path.name for folder in folders for path in folder.glob("*.npz")}):
        states = [state for folder in folders if (state := _read_state(folder / name)) is not None]
        if not states:
            continue
        histograms = Histograms(states[0]["low"], states[0]["width"])
        covered, seen = np.zeros(int(states[0]["flights"]), bool), _nothing_seen(states[0]["low"].size)
        for state in states:
            mask = np.unpackbits(state["covered"], count=int(state["flights"])).astype(bool)
            if any(not np.array_equal(state[key], states[0][key]) for key in ("low", "width", "flights")):
                raise ValueError(f"{name}: envelopes with other bins")
            if (mask & covered).any():
                raise ValueError(f"{name}: flights that two of them hold")
            histograms.merge(state["counts"], state["extremes"])
            covered |= mask
            seen = _widen(seen, state["seen"])
        _write_state(target / name, histograms, covered, seen)
