"""Blocks of flights in batches that fill the kernel's vector lanes, and retries of lost blocks.

Lost blocks are computed again in smaller pieces down to single flights. A block consists of
consecutive missing flights of one controller.

A flight that cannot be computed has the outcome ``failed_to_run``. If native code of a control law
may have ended or blocked the process, the outcome is ``law_crashed`` or ``law_hung``, which count
like ``law_failed``.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.flights.blocks import FlightBlock, join_blocks, make_failed_block, make_recording
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import counted, notify

if TYPE_CHECKING:
    from abhv_mc.interfaces import Fly, Recorded

Attempt = Callable[[Floats, "Recorded"], FlightBlock]

# number of flights per call: large enough to fill all lanes, small enough to lose little in a crash
BATCH_FLIGHTS = 256
_LANES = 32  # flights that compiled code computes together; fewer cost as much
PIECE = 16  # flights per piece after a block is first divided; time limits apply to this number
_reported: set[str] = set()  # messages about lost flights that were already reported
# Single flights are tried twice, because a process may have been killed from outside.
_PIECES = (PIECE, 1, 1)


class FlightLostError(Exception):
    """Error raised if flights are lost by an exception, a crash or the time limit (``hung``)."""

    def __init__(self, message: str, process: bool = False, hung: bool = False) -> None:
        super().__init__(message)
        self.process, self.hung = process, hung


class UnusableError(Exception):
    """Error raised if no flight can be computed; the campaign stops and records no failures."""


def time_limit(flights: int, piece_limit: float) -> float:
    """Return the time limit (s) for ``flights`` flights.

    ``piece_limit`` is the time limit (s) for up to PIECE flights.
    """
    return piece_limit * math.ceil(flights / PIECE)


def fly_with_retries(
    attempt: Attempt, plan: Any, parameters: Floats, recorded: "Recorded"
) -> FlightBlock:
    """Compute the flights of ``parameters`` with ``attempt``, and retry lost flights.

    After a loss, the block is computed in smaller pieces. Flights that are lost even when computed
    alone get the outcome ``failed_to_run``. Raise UnusableError if there are PIECE or more flights,
    none of which can be computed.
    """
    if len(parameters) > BATCH_FLIGHTS:
        try:
            return attempt(parameters, recorded)
        except FlightLostError:
            return fly_in_batches(
                lambda _, *batch: fly_with_retries(attempt, plan, *batch),
                plan,
                parameters,
                recorded,
            )
    reasons: list[str] = []
    block = _fly(attempt, plan, parameters, recorded, _PIECES, reasons=reasons)
    if reasons:
        if len(parameters) >= PIECE and (block.outcome == Outcome.FAILED_TO_RUN).all():
            raise UnusableError(
                f"none of {counted(len(parameters), 'flight')} could be computed ({reasons[-1]})"
            )
        for reason in reasons:
            notify(f"controller '{plan.controller}': a flight could not be computed: {reason}")
    return block


def _fly(
    attempt: Attempt,
    plan: Any,
    parameters: Floats,
    recorded: "Recorded",
    sizes: tuple[int, ...],
    *,
    reasons: list[str],
) -> FlightBlock:
    try:
        return attempt(parameters, recorded)
    except FlightLostError as error:
        if sizes is _PIECES and str(error) not in _reported:
            _reported.add(str(error))
            notify(
                f"controller '{plan.controller}': a block of "
                f"{counted(len(parameters), 'flight')} was lost ({error}) and is computed again "
                "in smaller blocks"
            )
        if not sizes:
            reasons.append(str(error))
            outcome = plan.lost_outcome(error.hung) if error.process else Outcome.FAILED_TO_RUN
            return replace(make_failed(plan, recorded, outcome), reasons={0: str(error)})
        pieces = np.split(parameters, range(sizes[0], len(parameters), sizes[0]))
        return join_blocks(
            [_fly(attempt, plan, piece, recorded, sizes[1:], reasons=reasons) for piece in pieces]
        )


def make_failed(
    plan: Any, recorded: "Recorded", outcome: Outcome = Outcome.FAILED_TO_RUN
) -> FlightBlock:
    """Return the block of one flight that could not be computed."""
    return make_failed_block(plan, outcome, make_recording(recorded, plan), plan.metric_count)


def fly_in_batches(
    fly: "Fly",
    plan: Any,
    parameters: Floats,
    recorded: "Recorded",
    begin: Callable[[], None] = lambda: None,
) -> FlightBlock:
    """Simulate all rows in batches, and call ``begin`` before each batch."""
    blocks = []
    for first in range(0, max(1, len(parameters)), BATCH_FLIGHTS):
        begin()
        blocks.append(fly(plan, parameters[first : first + BATCH_FLIGHTS], recorded))
    return blocks[0] if len(blocks) == 1 else join_blocks(blocks)


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
    return max(_LANES, min(BATCH_FLIGHTS, -(-share // _LANES) * _LANES))


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
