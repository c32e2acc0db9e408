"""Retries: a block that is lost is flown again in smaller pieces, down to the single flight that cannot be computed.

That flight has the outcome ``failed_to_run``, which says nothing about the vehicle; where native code of a law's may
have ended or held up its process, ``law_crashed`` or ``law_hung``, which count as ``law_failed`` does.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.execution.fly_batches import AT_ONCE, fly_in_batches
from abhv_mc.flight.child_flights import make_failed_block
from abhv_mc.flight.outcome import Outcome, find_lost_outcome
from abhv_mc.flight.plan import FlightBlock, FlightPlan, join_blocks, make_recording
from abhv_mc.simulators.margin_plans import count_metrics

if TYPE_CHECKING:  # which a worker process need not import
    from abhv_mc.interfaces import Recorded

Attempt = Callable[[Floats, "Recorded"], FlightBlock]

PIECE = 16  # flights of the first smaller pieces, and those that one time limit holds for
_told: set[str] = set()  # losses that were said already
_PIECES = (
    PIECE,
    1,
    1,
)  # a single flight is tried twice: its process may have been killed from outside


class FlightLostError(Exception):
    """Flights that raised, took too long (``hung``) or ended their ``process``; the message says which of these."""

    def __init__(self, words: str, process: bool = False, hung: bool = False) -> None:
        super().__init__(words)
        self.process, self.hung = process, hung


class UnusableError(Exception):
    """This machine computes no flight at all: the campaign stops, and nothing wrong is recorded."""


def time_limit(flights: int, one: float) -> float:
    """Seconds that so many flights may take where one flight, or up to PIECE of them, may take ``one``."""
    return one * math.ceil(flights / PIECE)


def fly_with_retries(
    attempt: Attempt, plan: FlightPlan, parameters: Floats, recorded: "Recorded"
) -> FlightBlock:
    """What ``attempt`` makes of the rows, with ``failed_to_run`` for those that are lost alone, too.

    A block of several batches is flown batch by batch then. Raises UnusableError where not one of
    PIECE or more flights could be computed.
    """
    if len(parameters) > AT_ONCE:
        try:
            return attempt(parameters, recorded)
        except FlightLostError:
            return fly_in_batches(
                lambda _, *rest: fly_with_retries(attempt, plan, *rest), plan, parameters, recorded
            )
    reasons: list[str] = []
    block = _fly(attempt, plan, parameters, recorded, _PIECES, reasons=reasons)
    if reasons:
        if len(parameters) >= PIECE and (block.outcome == Outcome.FAILED_TO_RUN).all():
            raise UnusableError(
                f"none of {len(parameters)} flights could be computed here: {reasons[-1]}"
            )
        for reason in reasons:
            print(
                f"{plan.controller}: a flight could not be computed: {reason}",
                file=sys.stderr,
                flush=True,
            )
    return block


def _fly(
    attempt: Attempt,
    plan: FlightPlan,
    parameters: Floats,
    recorded: "Recorded",
    sizes: tuple[int, ...],
    *,
    reasons: list[str],
) -> FlightBlock:
    try:
        return attempt(parameters, recorded)
    except FlightLostError as error:
        if sizes is _PIECES and str(error) not in _told:
            _told.add(str(error))
            words = f"{len(parameters)} flights were lost ({error}) and are flown again in smaller pieces"
            print(f"{plan.controller}: {words}", file=sys.stderr, flush=True)
        if not sizes:
            reasons.append(str(error))
            outcome = (
                find_lost_outcome(plan.law, error.hung) if error.process else Outcome.FAILED_TO_RUN
            )
            lost = make_failed_block(
                plan, outcome, make_recording(recorded, plan), count_metrics(plan)
            )
            return replace(lost, reasons={0: str(error)})
        pieces = np.split(parameters, range(sizes[0], len(parameters), sizes[0]))
        return join_blocks(
            [_fly(attempt, plan, piece, recorded, sizes[1:], reasons=reasons) for piece in pieces]
        )


def make_failed(plan: FlightPlan, recorded: "Recorded") -> FlightBlock:
    """The row of one flight that could not be computed."""
    return make_failed_block(
        plan, Outcome.FAILED_TO_RUN, make_recording(recorded, plan), count_metrics(plan)
    )
