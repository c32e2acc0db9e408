"""Blocks of flights in batches that fill the kernel's vector lanes, and retries of lost blocks.

Lost blocks are computed again in smaller pieces down to single flights.

A flight that cannot be computed has the outcome ``failed_to_run``. If native code of a control law
may have ended or blocked the process, the outcome is ``law_crashed`` or ``law_hung``, which count
like ``law_failed``.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flights.blocks import FlightBlock, join_blocks, make_failed_block, make_recording
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.phrases import counted

if TYPE_CHECKING:
    from abhv_mc.interfaces import Fly, Recorded

Attempt = Callable[[Floats, "Recorded"], FlightBlock]

# number of flights per call: large enough to fill all lanes, small enough to lose little in a crash
BATCH_FLIGHTS = 256
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
            print(
                f"controller '{plan.controller}': a flight could not be computed: {reason}",
                file=sys.stderr,
                flush=True,
            )
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
            print(
                f"controller '{plan.controller}': a block of "
                f"{counted(len(parameters), 'flight')} was lost ({error}) and is computed again "
                "in smaller blocks",
                file=sys.stderr,
                flush=True,
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
