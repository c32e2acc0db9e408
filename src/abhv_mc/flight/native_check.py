"""A law in native code tried before it flies: a flight must not depend on the flights beside or before it."""

import hashlib
from dataclasses import replace

import numpy as np

from abhv_mc.compiler_target import code_folder
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.input_error import InputError
from abhv_mc.jit import compiler
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.user_code.child import LostError, in_child

_TICKS = 50
_LONGEST = 600.0  # s, compiling included


def check_native(plan: FlightPlan) -> None:
    """Fly two flights of a plan apart, together and in swapped order, once for each content of the law.

    Raises InputError for a law that crashes or hangs at once, or that keeps memory of its own.
    """
    source = plan.source
    if source is None:
        raise ValueError("a plan of native code without its source")
    key = hashlib.sha256(f"{source.hash} {plan.settings.tolist()}".encode()).hexdigest()[:24]
    note = code_folder(compiler()) / "laws" / f"flown_{key}"
    if note.exists():
        return
    ticks = min(_TICKS, plan.timing.ticks)
    try:
        same = in_child(_is_same, replace(plan, timing=plan.timing._replace(ticks=ticks)), limit=_LONGEST)
    except LostError as lost:
        found = f"a law that does not fly the first {ticks} ticks of a nominal flight: {lost.words}"
        raise InputError(source.file, None, None, found, "a law that returns") from None
    if not same:
        found = "a law that keeps memory of its own: a flight depends on those beside it or before it"
        raise InputError(source.file, None, None, found, "all memory in the flight's state, and nothing in statics")
    with atomic_write(note) as aside:
        aside.write_text("", encoding="utf-8")


def _is_same(plan: FlightPlan) -> bool:
    parameters = nominal_parameters(2)
    parameters[1, PARAMETER_INDEX["initial.bank"]] += 0.05
    parameters[1, PARAMETER_INDEX["atmosphere.density"]] *= 1.05
    apart = [fly(plan, row[None], 1).history[0] for row in parameters]
    together = fly(plan, parameters, 1).history
    swapped = fly(plan, parameters[::-1], 1).history[::-1]
    return all(np.array_equal(each, np.stack(apart), equal_nan=True) for each in (together, swapped))
