"""The check shots that a file brings, run through the Python written from it."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from abhv_mc.daveml.formulas import MODEL
from abhv_mc.daveml.graph import Model
from abhv_mc.daveml.writer import write_module
from abhv_mc.io.input_error import InputError, InputErrors
from abhv_mc.user_code.module import run_module
from abhv_mc.user_code.source import UserSource

_WITHOUT_TOLERANCE = 1e-6  # of a value for which the file gives none


def make_function(model: Model) -> Callable[..., Any]:
    """The written model as a function of its inputs by their Python names; it gives a named tuple of outputs."""
    function: Callable[..., Any] = run_module(UserSource(write_module(model), str(model.path))).names[MODEL]
    return function


def run_shots(model: Model) -> None:
    """Run every check shot, with what internal values have a tolerance. Raises InputErrors with all that is off."""
    checked = {signal.identifier for shot in model.shots for signal in (*shot.internals, *shot.outputs)}
    seen = {key: replace(v, is_output=v.is_output or key in checked) for key, v in model.variables.items()}
    errors = list(_differences(replace(model, variables=seen))) if model.shots else []
    if errors:
        raise InputErrors(errors)


def _differences(model: Model) -> Iterator[InputError]:
    function, known = make_function(model), {variable.identifier: variable.key for variable in model.inputs}
    for shot in model.shots:
        given = {known[signal.identifier]: signal.value for signal in shot.inputs if signal.identifier in known}
        missing = [v.name for v in model.inputs if v.initial is None and v.key not in given]
        if missing:
            line = shot.inputs[0].line if shot.inputs else None
            yield InputError(model.path, f"the check shot '{shot.name}' without {', '.join(missing)}", "it", line)
            continue
        found_values = function(**given)
        internals = [signal for signal in shot.internals if signal.tolerance is not None]
        for signal in (*internals, *shot.outputs):
            value = float(getattr(found_values, model.variables[signal.identifier].key))
            allowed = _WITHOUT_TOLERANCE * max(1.0, abs(signal.value)) if signal.tolerance is None else signal.tolerance
            if not math.isfinite(value) or abs(value - signal.value) > allowed:
                found = f"{value!r} for '{signal.identifier}' in the check shot '{shot.name}'"
                yield InputError(model.path, found, f"{signal.value!r} within {allowed!r}", signal.line)
