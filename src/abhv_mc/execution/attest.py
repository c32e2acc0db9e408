"""Who flew a block: each carries its flyer, whose code is compared where the block is merged."""

import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.execution.retry import UnusableError
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.identity import Flyer, this_flyer

if TYPE_CHECKING:  # which a worker process need not import
    from abhv_mc.interfaces import Engine

Check = Callable[[FlightPlan, Floats, FlightBlock], FlightBlock]


def sign(block: FlightBlock) -> FlightBlock:
    """The block with this process as its flyer."""
    return replace(block, flown_by=(this_flyer(),))


class Attestation:
    """Compares who flew with who asked; threads may call it side by side."""

    def __init__(self, engine: "Engine", every_worker: bool = False) -> None:
        """``every_worker``: fly one flight of each again; otherwise of each host with another kind of processor."""
        self._engine, self._every = engine, every_worker
        self._seen: set[Any] = set()
        self._lock = threading.Lock()

    def check(self, plan: FlightPlan, parameters: Floats, block: FlightBlock) -> FlightBlock:
        """The block. Raises UnusableError, which names the flyer, for other code and for other bits."""
        if self._engine.checked and not block.flown_by:
            raise UnusableError(
                "a worker does not say which code it has: start it anew from the campaign's"
            )
        for flyer in block.flown_by:
            if self._engine.checked and flyer.code != self._engine.source:
                found = f"another version of the program (source {flyer.code}, the campaign's is {self._engine.source})"
                raise UnusableError(
                    f"the worker at {flyer.name} has {found}: start it anew from the same code"
                )
            with self._lock:
                mark = flyer if self._every else flyer._replace(process=0)
                new = mark not in self._seen and (
                    self._every or flyer.features != this_flyer().features
                )
                self._seen.add(mark)
            if new and len(parameters):
                self._fly_again(plan, parameters[:1], block, flyer)
        return block

    def _fly_again(
        self, plan: FlightPlan, parameters: Floats, block: FlightBlock, flyer: Flyer
    ) -> None:
        here = self._engine.fly(plan, parameters, None)
        for name in ("outcome", "end_time", "metrics"):
            if not np.array_equal(
                getattr(here, name)[0], getattr(block, name)[0], equal_nan=name != "outcome"
            ):
                found = f"other bits than this machine ({name} of one flight of {plan.controller})"
                raise UnusableError(f"the worker at {flyer.name} ({flyer.processor}) flies {found}")
        print(
            f"worker at {flyer.name}: a flight is the same here, bit for bit",
            file=sys.stderr,
            flush=True,
        )
