"""A law in native code tried before it flies, for memory of its own, and before its slopes are taken."""

import hashlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.fly import fly, fly_until, nominal_parameters
from abhv_mc.flight.lost import describe_last_tick
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.flight.user_law import hidden_memory, plan_source
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.user_code.child import LostError, in_child
from abhv_mc.user_code.unpack import laws_folder

_TICKS = 50
_SLOW_TICKS = 200  # for what a memory does to a flight to grow
_ALIKE = 1e-6  # of a flight whose states are set anew at each tick: the integrators of some FMUs then start anew
_LONGEST = 600.0  # s, compiling included


def check_native(plan: FlightPlan) -> None:
    """Fly two flights apart, together and in swapped order, once for each content of the law. Raises InputError."""
    file = plan_source(plan).file
    try:
        same = _try_once(_is_same, plan, _TICKS)
    except LostError as lost:
        words = f"{lost.words}{describe_last_tick(lost.process)}"
        found = f"a law that does not fly the first {_TICKS} ticks of a nominal flight: {words}"
        raise InputError(file, found, "a law that returns") from None
    if not same:
        found = (
            "a law that keeps memory of its own: a flight depends on those beside it or before it"
        )
        expected = (
            "all memory in the flight's state; for generated code with global structures three lines around its step: "
            "'model_DW = saved->dw; model_step(); saved->dw = model_DW;' (docs/how-to/c-law.md)"
        )
        raise InputError(file, found, expected)


def check_states(plan: FlightPlan) -> None:
    """Fly an FMU with its states set anew at each tick, and left alone. Raises InputError where that differs."""
    if not _try_once(_has_all_states, plan, _SLOW_TICKS):
        raise hidden_memory(plan)


def _try_once(is_right: Callable[[FlightPlan], bool], plan: FlightPlan, ticks: int) -> bool:
    """What a check of a plan's law says in the child; what was found right is noted by the law's content."""
    key = hashlib.sha256(f"{plan_source(plan).hash} {plan.settings.tolist()}".encode()).hexdigest()[
        :24
    ]
    note = laws_folder() / f"{is_right.__name__.strip('_')}_{key}"
    if note.exists():
        return True
    shorter = replace(plan, timing=plan.timing._replace(ticks=min(ticks, plan.timing.ticks)))
    if not in_child(is_right, shorter, limit=_LONGEST):
        return False
    note.touch()
    return True


def _is_same(plan: FlightPlan) -> bool:
    parameters = _two_flights()
    apart = [fly(plan, row[None], 1).history[0] for row in parameters]
    together = fly(plan, parameters, 1).history
    swapped = fly(plan, parameters[::-1], 1).history[::-1]
    return all(
        np.array_equal(each, np.stack(apart), equal_nan=True) for each in (together, swapped)
    )


def _has_all_states(plan: FlightPlan) -> bool:
    parameters = _two_flights()
    alone = fly(plan, parameters, 1, keep_states=True).states[:, 1:]
    anew = fly(plan, parameters, 1, keep_states=True, start=fly_until(plan, parameters, 0)).states[
        :, 1:
    ]
    return np.allclose(anew, alone, rtol=_ALIKE, atol=_ALIKE, equal_nan=True)


def _two_flights() -> Floats:
    parameters = nominal_parameters(2)
    parameters[1, PARAMETER_INDEX["initial.bank"]] += 0.05
    parameters[1, PARAMETER_INDEX["atmosphere.density"]] *= 1.05
    return parameters
