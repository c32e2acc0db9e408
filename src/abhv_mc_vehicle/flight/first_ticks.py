"""Check of a custom control law in the first control ticks of the nominal flight."""

import re
from dataclasses import replace

import numpy as np

from abhv_mc.custom_code.child import run_in_thread
from abhv_mc.flights.outcomes import LAW_LOST, Outcome
from abhv_mc.io.input_error import InputError
from abhv_mc_vehicle.control.law_file import PYTHON
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.user_law import load_plan_law, plan_source
from abhv_mc_vehicle.user_code.plain_law import failures

_LAST = 1  # The second tick reads the memory that the control law returned at the first tick.
_LONGEST = 600.0  # time limit including compilation, s
_COMMANDS = ("gamma_cmd", "alpha_cmd", "bank_cmd", "cmd_", "effector_asked")


def check_first_ticks(plan: FlightPlan) -> None:
    """Raise InputError if a custom control law fails or returns non-finite commands.

    Only the first two ticks of the nominal flight are simulated.
    """
    source = plan_source(plan)
    line, returned = _find_step(plan), "Filtered" if plan.around else "Command"
    start = replace(plan, timing=plan.timing._replace(ticks=min(_LAST, plan.timing.ticks)))
    try:
        block = run_in_thread(lambda: fly(start, nominal_parameters(), 1), _LONGEST)
    except TimeoutError:
        problem = f"the first ticks of the control law take more than {_LONGEST:g} s"
        raise InputError(
            source.file, problem, "a control law without endless loops", line
        ) from None
    if block.outcome[0] in (Outcome.LAW_FAILED, *LAW_LOST):
        raised, exception = failures.get(source.hash, (None, ""))
        failure = f"raised an exception ({exception})" if exception else "returned an error"
        problem = f"{_at(block.end_time[0])}, the control law {failure}"
        raise InputError(
            source.file, problem, "a control law that returns commands", raised or line
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
            expected = (
                f"finite numbers in {returned}(...); check divisions by control errors, which "
                "are zero at the start"
            )
            raise InputError(
                source.file, f"the {broken[0]} is not finite {_at(time)}", expected, line
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
