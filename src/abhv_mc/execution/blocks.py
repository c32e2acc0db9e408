"""Work units: blocks of consecutive flights of one controller, cut from whatever is still missing."""

import contextlib
import threading
import warnings
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.flight.plan import LANES, FlightBlock, FlightPlan, Recording, join_blocks
from abhv_mc.folder.counted import CountedBlock, Counting
from abhv_mc.folder.histogram import Histograms

T = TypeVar("T")
Recorded = Recording | int | None  # as flight.fly takes it
ToRecord = Counting | Recorded
Fly = Callable[[FlightPlan, Floats, Recorded], FlightBlock]  # in one call
FlyBlocks = Callable[[FlightPlan, Floats, ToRecord], FlightBlock]  # by whoever flies blocks

_BLOCK = 256  # flights of one: enough for every lane, few enough to lose
_COUNTED = 8192  # flights of a block that comes back counted, some ten seconds of work: what a kill costs a worker


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
    return max(LANES, min(_BLOCK, -(-share // LANES) * LANES))


def choose_counted(flights: int, workers: int, batch: int) -> int:
    """Flights of a block of which the worker counts the envelopes: whole batches, four blocks or more a worker."""
    share = -(-flights // (4 * workers))
    return batch * max(1, min(_COUNTED, share) // batch)


def fly_recorded(
    fly: Fly, plan: FlightPlan, parameters: Floats, recorded: ToRecord, begin: Callable[[], None] = lambda: None
) -> FlightBlock:
    """What every worker does; ``begin`` is called before each call of ``fly``."""
    if isinstance(recorded, Counting):
        return fly_counted(fly, plan, parameters, recorded, begin)
    begin()
    return fly(plan, parameters, recorded)


def fly_counted(
    fly: Fly, plan: FlightPlan, parameters: Floats, counting: Counting, begin: Callable[[], None] = lambda: None
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
    return CountedBlock(**parts, counts=histograms.counts, ends=histograms.tails())


def at_once(parameters: Floats, recorded: ToRecord) -> int:
    """Flights of one call of ``fly``."""
    return min(len(parameters), recorded.batch) if isinstance(recorded, Counting) else len(parameters)


def cut_blocks(missing: dict[str, tuple[Mask, Mask]], size: int, cut: int = 0) -> Iterator[Block]:
    """Blocks of at most ``size`` flights, controllers in turn; ``missing`` holds masks of rows and envelopes.

    Block ends lie on multiples of ``size``, and within a block the same is missing of every flight; no block holds
    flights of both sides of ``cut``.
    """
    runs = {name: list(_uniform_runs(rows, envelope, size, cut)) for name, (rows, envelope) in missing.items()}
    for turn in range(max(map(len, runs.values()), default=0)):
        for name, pieces in runs.items():
            if turn < len(pieces):
                first, stop = pieces[turn]
                rows, envelope = missing[name]
                yield Block(name, first, stop, bool(rows[first]), bool(envelope[first]))


def _uniform_runs(rows: Mask, envelope: Mask, size: int, cut: int) -> Iterator[tuple[int, int]]:
    state = rows.astype(np.int8) + 2 * envelope.astype(np.int8)
    changes = np.flatnonzero(np.diff(state)) + 1
    ends = np.unique(np.concatenate([changes, np.arange(0, len(state), size), [min(cut, len(state)), len(state)]]))
    for first, stop in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        if state[first]:
            yield first, stop


def fly_block(
    fly: FlyBlocks, plan: FlightPlan, block: Block, parameters: Floats, recorded: ToRecord
) -> tuple[Block, FlightBlock]:
    """A block and its flights, from a thread of the launching process that hands it to whoever flies blocks."""
    return block, fly(plan, parameters, recorded if block.envelope else None)


class Backpressure:
    """Limits the blocks that are being flown or wait to be written.

    Without it, workers that are faster than the disk would fill the memory with finished blocks.
    """

    def __init__(self, number: int) -> None:
        self._free = threading.Semaphore(number)
        self._closed = False

    def call(self, work: Callable[..., T], *arguments: Any) -> T:
        """What ``work`` gives once there is room. Raises RuntimeError after :meth:`close`, when nobody listens."""
        self._free.acquire()
        if self._closed:
            self.free()  # so that the next one ends, too
            raise RuntimeError("nobody waits for this block")
        return work(*arguments)

    def free(self) -> None:
        """Make room: a block was written."""
        self._free.release()

    def close(self) -> None:
        """Let every waiting worker end."""
        self._closed = True
        self.free()


@contextlib.contextmanager
def closing_quietly(results: Generator[Any, None, None]) -> Iterator[None]:
    """Stop the workers at the end; joblib's warning that not all was used is what an interrupt means."""
    try:
        yield
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            results.close()
