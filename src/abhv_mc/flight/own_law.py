"""A plan's own law as the kernel calls it: its address, which holds while it flies."""

import contextlib
from collections.abc import Iterator
from typing import Any

from abhv_mc.control.own.compiled import compile_law
from abhv_mc.control.own.plain import PlainLaw
from abhv_mc.control.own.source import load_law
from abhv_mc.flight.arguments import OwnLaw
from abhv_mc.flight.plan import FlightPlan


@contextlib.contextmanager
def open_law(plan: FlightPlan, width: int) -> Iterator[OwnLaw]:
    """The law of a plan for ``width`` lanes; nothing for the laws of the program.

    Raises ValueError for a plan whose source is missing: a stored plan has none.
    """
    if plan.law != "python":
        yield OwnLaw(0, 0)
        return
    if plan.source is None or plan.source.hash != plan.source_hash:
        raise ValueError("a plan of a law of the user's own without its source")
    law, gains = load_law(plan.source), tuple(plan.gain_names.tolist())
    made: Any = compile_law(plan.source, gains, width) if law.mark.compiled else PlainLaw(law, gains, width)
    yield OwnLaw(int(made.address), int("onboard" in law.arguments))
