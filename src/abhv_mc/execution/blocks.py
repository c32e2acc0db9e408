"""Units of work: blocks of consecutive missing flights of one controller."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Mask
from abhv_mc.execution.retry import BATCH_FLIGHTS, PIECE

_WORK = 10.0  # intended computing time in s of a block of flights of a custom simulator
# Maximum number of flights in a block without histories. Such a block takes about ten seconds, and
# this work is lost if the worker is killed.
_MOST_FLIGHTS = 8192


@dataclass(frozen=True)
class Block:
    """Flights ``first`` to ``stop - 1`` of one controller, and their missing data."""

    controller: str
    first: int
    stop: int
    needs_rows: bool  # whether rows of the flights table are missing
    needs_envelope: bool  # whether contributions to the envelopes are missing

    @property
    def flights(self) -> int:
        return self.stop - self.first


def choose_batch(flights: int, workers: int) -> int:
    """Return the block size that fills all lanes and gives at least two blocks per worker."""
    share = -(-flights // (2 * workers))
    return max(PIECE, min(BATCH_FLIGHTS, -(-share // PIECE) * PIECE))


def choose_unrecorded(flights: int, workers: int, batch: int) -> int:
    """Return the block size for flights without histories: full batches, four per worker."""
    share = -(-flights // (4 * workers))
    return batch * max(1, min(_MOST_FLIGHTS, share) // batch)


def choose_timed(flights: int, workers: int, seconds: float) -> int:
    """Return the block size for a custom simulator: about ten seconds of computing time.

    ``seconds`` is the computing time of one flight in s.
    """
    share = -(-flights // (4 * workers))
    return max(1, min(_MOST_FLIGHTS, share, int(_WORK / seconds) if seconds else _MOST_FLIGHTS))


def cut_blocks(
    missing: dict[str, tuple[Mask, Mask]],
    size: int,
    cut: int = 0,
    unrecorded: tuple[int, int] | None = None,
) -> Iterator[Block]:
    """Yield blocks of at most ``size`` flights, alternating between controllers.

    ``missing`` gives, by controller, the masks [flight] of missing rows and missing envelope
    contributions. Blocks end at multiples of ``size``, and the same data is missing for all flights
    of a block. No block contains flights on both sides of ``cut``. ``unrecorded`` contains the
    number of the first flight without a recorded history, and the block size from that flight on.
    """
    ranges = {
        name: list(_uniform_ranges(rows, envelope, size, cut, unrecorded))
        for name, (rows, envelope) in missing.items()
    }
    for turn in range(max(map(len, ranges.values()), default=0)):
        for name, own_ranges in ranges.items():
            if turn < len(own_ranges):
                first, stop = own_ranges[turn]
                rows, envelope = missing[name]
                yield Block(name, first, stop, bool(rows[first]), bool(envelope[first]))


def _uniform_ranges(
    rows: Mask, envelope: Mask, size: int, cut: int, unrecorded: tuple[int, int] | None
) -> Iterator[tuple[int, int]]:
    """Yield (first, stop) for each range of flights for which the same data is missing."""
    first_unrecorded, unrecorded_size = unrecorded or (len(rows), size)
    state = rows.astype(np.int8) + 2 * envelope.astype(np.int8)
    changes = np.flatnonzero(np.diff(state)) + 1
    ends = np.unique(
        np.concatenate(
            [
                changes,
                np.arange(0, min(first_unrecorded, len(state)), size),
                np.arange(first_unrecorded, len(state), unrecorded_size),
                [min(cut, len(state)), len(state)],
            ]
        )
    )
    for first, stop in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        if state[first]:
            yield first, stop
