"""The check shots that a file brings, run through the Python written from it."""

import math
from collections.abc import Callable, Iterator
from typing import Any

from abhv_mc.daveml.model import Model
from abhv_mc.daveml.writer import MODEL, python_names, write_module
from abhv_mc.io.input_error import InputError, InputErrors
from abhv_mc.user_code.source import UserSource, run_module

_WITHOUT_TOLERANCE = 1e-6  # of a value for which the file gives none


def make_function(model: Model) -> Callable[..., Any]:
    """The written model as a function of its inputs by their Python names; it gives a named tuple of outputs."""
    function: Callable[..., Any] = run_module(UserSource(write_module(model), str(model.path))).names[MODEL]
    return function


def run_shots(model: Model) -> None:
    """Run every check shot. Raises InputErrors with each output that is off by more than the file allows."""
    function, names = make_function(model), python_names(model)
    errors = list(_differences(model, function, names))
    if errors:
        raise InputErrors(errors)


def _differences(model: Model, function: Callable[..., Any], names: dict[str, str]) -> Iterator[InputError]:
    known = {variable.identifier for variable in model.inputs}
    given_by_itself = {variable.identifier for variable in model.outputs}
    for shot in model.shots:
        given = {names[signal.identifier]: signal.value for signal in shot.inputs if signal.identifier in known}
        missing = [v.name for v in model.inputs if v.initial is None and names[v.identifier] not in given]
        if missing:
            line = shot.inputs[0].line if shot.inputs else None
            yield InputError(model.path, line, None, f"the check shot '{shot.name}' without {', '.join(missing)}", "it")
            continue
        outputs = function(**given)
        for signal in shot.outputs:
            if signal.identifier not in given_by_itself:
                found = f"'{signal.identifier}' of the check shot '{shot.name}', which is no output"
                yield InputError(model.path, signal.line, None, found, "isOutput in its variable")
                continue
            value = float(getattr(outputs, names[signal.identifier]))
            allowed = _WITHOUT_TOLERANCE * max(1.0, abs(signal.value)) if signal.tolerance is None else signal.tolerance
            if not math.isfinite(value) or abs(value - signal.value) > allowed:
                found = f"{value!r} for '{signal.identifier}' in the check shot '{shot.name}'"
                yield InputError(model.path, signal.line, None, found, f"{signal.value!r} within {allowed!r}")
