"""Work units: blocks of consecutive flights of one controller, cut from whatever is still missing."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Mask
from abhv_mc.execution.fly_batches import AT_ONCE
from abhv_mc.kernel.flight.interface import LANES

_WORK = 10.0  # s
_MOST_PLAIN = 8192  # flights of a block that records nothing, some ten seconds of work: what a kill costs a worker


@dataclass(frozen=True)
class Block:
    """The flights ``first`` .. ``stop - 1`` of one controller, and what is missing of them."""

    controller: str
    first: int
    stop: int
    rows: bool  # their rows
    envelope: bool  # their part in the envelopes

    @property
    def flights(self) -> int:
        return self.stop - self.first


def choose_batch(flights: int, workers: int) -> int:
    """Flights of a block: at least a few blocks for every worker, a whole number of lanes."""
    share = -(-flights // (2 * workers))
    return max(LANES, min(AT_ONCE, -(-share // LANES) * LANES))


def choose_plain(flights: int, workers: int, batch: int) -> int:
    """Flights of a block that records nothing: whole batches, four blocks or more a worker."""
    share = -(-flights // (4 * workers))
    return batch * max(1, min(_MOST_PLAIN, share) // batch)


def choose_timed(flights: int, workers: int, seconds: float) -> int:
    """Flights of a block of a user's simulator: some ten seconds of work by the time (s) of the first flights."""
    share = -(-flights // (4 * workers))
    return max(1, min(_MOST_PLAIN, share, int(_WORK / seconds) if seconds else _MOST_PLAIN))


def cut_blocks(
    missing: dict[str, tuple[Mask, Mask]],
    size: int,
    cut: int = 0,
    plain: tuple[int, int] | None = None,
) -> Iterator[Block]:
    """Blocks of at most ``size`` flights, controllers in turn; ``missing`` holds masks of rows and envelopes.

    Block ends lie on multiples of ``size``, and within a block the same is missing of every flight; no block holds
    flights of both sides of ``cut``. ``plain``: the flight from which on none records anything, and the size there.
    """
    runs = {
        name: list(_uniform_runs(rows, envelope, size, cut, plain))
        for name, (rows, envelope) in missing.items()
    }
    for turn in range(max(map(len, runs.values()), default=0)):
        for name, pieces in runs.items():
            if turn < len(pieces):
                first, stop = pieces[turn]
                rows, envelope = missing[name]
                yield Block(name, first, stop, bool(rows[first]), bool(envelope[first]))


def _uniform_runs(
    rows: Mask, envelope: Mask, size: int, cut: int, plain: tuple[int, int] | None
) -> Iterator[tuple[int, int]]:
    first_plain, plain_size = plain or (len(rows), size)
    state = rows.astype(np.int8) + 2 * envelope.astype(np.int8)
    changes = np.flatnonzero(np.diff(state)) + 1
    ends = np.unique(
        np.concatenate(
            [
                changes,
                np.arange(0, min(first_plain, len(state)), size),
                np.arange(first_plain, len(state), plain_size),
                [min(cut, len(state)), len(state)],
            ]
        )
    )
    for first, stop in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        if state[first]:
            yield first, stop
