"""Checks of custom control laws: first control ticks, hidden memory and settable states.

The first control ticks are those of the nominal flight. Native laws may have hidden memory, or
states that cannot be set.
"""

import hashlib
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.child import LostError, in_child, run_in_thread
from abhv_mc.flights.outcomes import LAW_LOST, Outcome
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.law_file import PYTHON
from abhv_mc_vehicle.flight.fly import describe_last_tick, fly, fly_until, nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.user_law import hidden_memory_error, load_plan_law, plan_source
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.user_code.plain_law import failures
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
        raise InputError(
            file,
            f"the control law fails in the first {_TICKS} ticks of a nominal flight ({reason})",
            "a control law that returns a command at each tick",
        ) from None
    if not is_independent:
        raise InputError(
            file,
            "the control law has hidden memory, so a flight depends on other flights",
            "all memory in the state of the flight; for generated code with global structures, "
            "add three lines around its step: 'model_DW = saved->dw; model_step(); saved->dw = "
            "model_DW;' "
            "(docs/how-to/generated-code.md)",
        )


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


_LAST = 1  # The second tick reads the memory that the control law returned at the first tick.
_COMMANDS = ("gamma_cmd", "alpha_cmd", "bank_cmd", "cmd_", "effector_asked")


def check_first_ticks(plan: FlightPlan) -> None:
    """Raise InputError if a custom control law fails or returns non-finite commands.

    Only the first two ticks of the nominal flight are simulated.
    """
    source = plan_source(plan)
    line = _find_step(plan)
    returned = "Filtered" if plan.around else "Command"
    start = replace(plan, timing=plan.timing._replace(ticks=min(_LAST, plan.timing.ticks)))
    try:
        block = run_in_thread(lambda: fly(start, nominal_parameters(), 1), _LONGEST)
    except TimeoutError:
        raise InputError(
            source.file,
            f"the first ticks of the control law take more than {_LONGEST:g} s",
            "a control law without endless loops",
            line,
        ) from None
    if block.outcome[0] in (Outcome.LAW_FAILED, *LAW_LOST):
        raised, exception = failures.get(source.hash, (None, ""))
        failure = f"raised an exception ({exception})" if exception else "returned an error"
        raise InputError(
            source.file,
            f"{_at(block.end_time[0])}, the control law {failure}",
            "a control law that returns commands",
            raised or line,
        )
    if block.outcome[0] != Outcome.NOT_FINITE:
        return
    for time, row in zip(block.times, block.history[0], strict=True):
        broken = [
            channel.doc
            for channel, value in zip(plan.channels, row.tolist(), strict=True)
            if channel.source.startswith(_COMMANDS) and not np.isfinite(value)
        ]
        if broken and np.isfinite(row).any():  # Rows after the end of the flight contain only NaN.
            raise InputError(
                source.file,
                f"the {broken[0]} is not finite {_at(time)}",
                f"finite numbers in {returned}(...); check divisions by control errors, which "
                "are zero at the start",
                line,
            )


def _at(time: float) -> str:
    return f"at {time:g} s of the nominal flight"


def _find_step(plan: FlightPlan) -> int | None:
    """Return the line of a control law's function in its source; None for binary files."""
    source = plan_source(plan)
    if plan.law == PYTHON:
        law = load_plan_law(plan)
        return int(law.module.texts[law.function.__name__].lineno)
    text = source.files[0][1].decode(errors="replace")
    step = re.search(r"\babhv_law_step\s*\(", text)
    return text.count("\n", 0, step.start()) + 1 if step else None
