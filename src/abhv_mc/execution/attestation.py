"""Signatures of processes that compute blocks of flights, and checks of their code."""

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.execution.retry import UnusableError
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.identity import Flyer, this_flyer
from abhv_mc.io.messages import notify

if TYPE_CHECKING:  # Worker processes do not import modules that only annotations need.
    from abhv_mc.interfaces import Engine

Check = Callable[[Any, Floats, FlightBlock], FlightBlock]


def sign(block: FlightBlock) -> FlightBlock:
    """Return the block with this process recorded as its origin."""
    return replace(block, flown_by=(this_flyer(),))


class Attestation:
    """Thread-safe check of the code and the results of workers."""

    def __init__(self, engine: "Engine", every_worker: bool = False) -> None:
        """Prepare the check of all workers.

        If a host's kind of processor differs from this machine's, one of the host's flights is
        computed again in this process. With ``every_worker``, one flight of each worker is computed
        again.
        """
        self._engine, self._every = engine, every_worker
        self._seen: set[Any] = set()
        self._lock = threading.Lock()

    def check(self, plan: Any, parameters: Floats, block: FlightBlock) -> FlightBlock:
        """Check a block and return it unchanged.

        Raise UnusableError, which names the worker, if the worker's code or any bit of its results
        differs.
        """
        self.check_code(block)
        for flyer in block.flown_by:
            with self._lock:
                worker = flyer if self._every else flyer._replace(process=0)
                is_due = worker not in self._seen and (
                    self._every or flyer.features != this_flyer().features
                )
                self._seen.add(worker)
            if is_due and len(parameters):
                self._compare(plan, parameters[:1], block, flyer)
        return block

    def check_code(self, block: FlightBlock) -> FlightBlock:
        """Return the block. Raise UnusableError if a worker's code differs or is not stated."""
        if not self._engine.checked:
            return block
        if not block.flown_by:
            raise UnusableError(
                "a worker does not report its version of the program; restart it with the version "
                "of the campaign"
            )
        for flyer in block.flown_by:
            if flyer.code != self._engine.source:
                raise UnusableError(
                    f"the worker at {flyer.name} has another version of the program (source hash "
                    f"{flyer.code} instead of {self._engine.source}); restart the worker with the "
                    "version of the campaign"
                )
        return block

    def _compare(self, plan: Any, parameters: Floats, block: FlightBlock, flyer: Flyer) -> None:
        """Compute the first flight of a block again. Raise UnusableError if any bit differs."""
        reference = self._engine.fly(plan, parameters, None)
        for name in ("outcome", "end_time", "metrics"):
            if not np.array_equal(
                getattr(reference, name)[0], getattr(block, name)[0], equal_nan=name != "outcome"
            ):
                raise UnusableError(
                    f"the worker at {flyer.name} ({flyer.processor}) computes results that differ "
                    f"from those of this machine ('{name}' of one flight of controller "
                    f"'{plan.controller}')"
                )
        notify(
            f"worker at {flyer.name}: one flight, computed again on this machine, is bit-identical"
        )
