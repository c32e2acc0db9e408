"""A plan's own law and channels as the kernel calls them: their addresses, which hold while it flies."""

import contextlib
from collections.abc import Iterator
from typing import Any

from abhv_mc.control.laws.own import MEMORY
from abhv_mc.flight.arguments import OwnLaw
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.own.channels import compile_channels
from abhv_mc.own.compiled import compile_law
from abhv_mc.own.plain import PlainLaw
from abhv_mc.own.source import Law, OwnSource, load_law
from abhv_mc.plant import state as s

PYTHON = "python"


@contextlib.contextmanager
def open_law(plan: FlightPlan, width: int) -> Iterator[OwnLaw]:
    """The law and the channels of a plan for ``width`` lanes; nothing for a plan without its own.

    Raises ValueError for a plan whose source is missing: a stored plan has none.
    """
    address, onboard, channels = 0, 0, 0
    made: Any = None  # held while it flies
    if plan.law == PYTHON:
        law = load_plan_law(plan)
        source, gains = law.source, tuple(plan.gain_names.tolist())
        made = compile_law(source, gains, width) if law.mark.compiled else PlainLaw(law, gains, width)
        address, onboard = int(made.address), int("onboard" in law.arguments)
    if plan.channels_hash:
        channels = int(compile_channels(_checked(plan.channels_source, plan.channels_hash), width).address)
    yield OwnLaw(address, onboard, channels)
    del made


def load_plan_law(plan: FlightPlan) -> Law:
    """The law of a plan that has its own."""
    return load_law(_checked(plan.source, plan.source_hash))


def _checked(source: OwnSource | None, digest: str) -> OwnSource:
    if source is None or source.hash != digest:
        raise ValueError("a plan of the user's own code without its source")
    return source


def law_memory_rows(plan: FlightPlan) -> dict[str, int]:
    """Rows of the lane memory that the plan's own law remembers, by name; the last commands where it sees them."""
    law = load_plan_law(plan)
    rows = {name: MEMORY + i for i, name in enumerate(law.memory._fields if "memory" in law.arguments else ())}
    if "onboard" in law.arguments:
        last = (s.CMD_AILERON, s.CMD_RUDDER, s.CMD_ELEVATOR, s.CMD_ETA)
        rows |= dict(zip(("last_aileron", "last_rudder", "last_elevator", "last_equivalence_ratio"), last, strict=True))
    return rows
