"""Checks whether native control laws have hidden memory or states that cannot be set."""

import hashlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.child import LostError, in_child
from abhv_mc.io.input_error import InputError
from abhv_mc_vehicle.flight.child_flights import describe_last_tick
from abhv_mc_vehicle.flight.fly import fly, fly_until, nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.user_law import hidden_memory_error, plan_source
from abhv_mc_vehicle.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc_vehicle.user_code.unpack import laws_folder

_TICKS = 50
_SLOW_TICKS = 200  # number of ticks, large enough for the effect of hidden memory to grow
# Relative tolerance if states are set, because this restarts the integrators of some FMUs.
_ALIKE = 1e-6
_LONGEST = 600.0  # time limit including compilation, s


def check_native(plan: FlightPlan) -> None:
    """Check that two flights are bit-identical when run alone, together and in swapped order.

    Each version of the control law's files is checked once. Raise InputError if the flights differ
    or the control law fails.
    """
    file = plan_source(plan).file
    try:
        is_independent = _try_once(_is_same, plan, _TICKS)
    except LostError as error:
        reason = f"{error.words}{describe_last_tick(error.process)}"
        problem = (
            f"the control law fails in the first {_TICKS} ticks of a nominal flight ({reason})"
        )
        raise InputError(
            file, problem, "a control law that returns a command at each tick"
        ) from None
    if not is_independent:
        problem = "the control law has hidden memory, so a flight depends on other flights"
        expected = (
            "all memory in the state of the flight; for generated code with global structures, "
            "add three lines around its step: 'model_DW = saved->dw; model_step(); saved->dw = "
            "model_DW;' "
            "(docs/how-to/generated-code.md)"
        )
        raise InputError(file, problem, expected)


def check_states(plan: FlightPlan) -> None:
    """Check that setting the states of an FMU after a tick does not change a flight.

    Raise InputError if the flights differ.
    """
    if not _try_once(_has_all_states, plan, _SLOW_TICKS):
        raise hidden_memory_error(plan)


def _try_once(is_right: Callable[[FlightPlan], bool], plan: FlightPlan, ticks: int) -> bool:
    """Run a check in the child process; skip it if this version of the law has passed."""
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
    separate = [fly(plan, row[None], 1).history[0] for row in parameters]
    together = fly(plan, parameters, 1).history
    swapped = fly(plan, parameters[::-1], 1).history[::-1]
    return all(
        np.array_equal(histories, np.stack(separate), equal_nan=True)
        for histories in (together, swapped)
    )


def _has_all_states(plan: FlightPlan) -> bool:
    parameters = _two_flights()
    unsaved = fly(plan, parameters, 1, keep_states=True).states[:, 1:]
    restored = fly(
        plan, parameters, 1, keep_states=True, start=fly_until(plan, parameters, 0)
    ).states[:, 1:]
    return np.allclose(restored, unsaved, rtol=_ALIKE, atol=_ALIKE, equal_nan=True)


def _two_flights() -> Floats:
    parameters = nominal_parameters(2)
    parameters[1, PARAMETER_INDEX["initial.bank"]] += 0.05
    parameters[1, PARAMETER_INDEX["atmosphere.density"]] *= 1.05
    return parameters
