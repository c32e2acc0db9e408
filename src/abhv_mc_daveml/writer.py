"""Python source text of a model (tables, constants and a function), and check-shot runs.

Statements consist of text of this module, identifiers and numbers. Text of the file is written only
to comments and docstrings, folded so that it cannot end them.
"""

import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.messages import InputError, InputErrors, quoted
from abhv_mc.io.xml_reader import fold
from abhv_mc_daveml.formulas import MODEL, OUTPUTS, TAKEN
from abhv_mc_daveml.graph import Model, Variable
from abhv_mc_daveml.look_ups import LookUp
from abhv_mc_vehicle.imported_vehicle import write_module
from abhv_mc_vehicle.user_code.module import run_module
from abhv_mc_vehicle.user_code.module_text import (
    INDENT,
    WIDTH,
    Line,
    call,
    declare,
    define,
    free_name,
    number,
    sequence,
)


def write_model(model: Model, extra: Sequence[Line] = ()) -> str:
    """Return the text of the module; `extra` follows the function of the model."""
    tables, functions = _tables(model)
    constants: list[Line] = []
    body: list[Line] = []
    for variable in model.variables.values():
        value = _value(variable, model, functions)
        if value is not None:
            line = Line(f"{variable.key} = {value}", variable.words)
            (body if variable.computed or variable.is_input else constants).append(line)
    body.append(Line(f"return {call(OUTPUTS, (v.key for v in model.outputs))}"))
    parameters = (
        v.key if v.initial is None else f"{v.key}={number(v.initial)}" for v in model.inputs
    )
    outputs = [declare(v.key, f"{v.name}, {v.units}") for v in model.outputs]
    lines = [
        *constants,
        *tables,
        *define(f"class {OUTPUTS}(NamedTuple):", "Outputs of the model.", outputs),
        *define(f"def {call(MODEL, parameters)}:", _docstring(model), body),
        *extra,
    ]
    degree = Line("DEGREE = 3.141592653589793 / 180.0", "rad")
    return write_module(_head(model), [degree], lines)


def _head(model: Model) -> str:
    version = f" ({model.version})" if model.version else ""
    origin = f"Imported from {fold(model.path.name)}{version}, SHA-256 {model.digest}."
    parts = filter(None, (model.name.rstrip(".") + ".", model.description, origin))
    return "\n\n".join(textwrap.fill(paragraph, WIDTH) for paragraph in parts)


def _value(variable: Variable, model: Model, functions: dict[str, str]) -> str | None:
    """Return the expression of a variable, or None for an input without limits."""
    value = variable.key
    if variable.formula is not None:
        value = variable.formula
    elif variable.look_up is not None:
        arguments = (
            _held(model, variable.look_up, axis) for axis in range(len(variable.look_up.arguments))
        )
        value = call(functions[variable.identifier], arguments)
    elif not variable.is_input:
        return number(variable.initial or 0.0)
    elif variable.low is None and variable.high is None:
        return None
    limited = _limited(value, variable.low, variable.high)
    too_long = limited == variable.formula and len(f"{INDENT}{variable.key} = {limited}") > WIDTH
    return f"({limited})" if too_long else limited


def _limited(value: str, low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"clamp({value}, {number(low)}, {number(high)})"
    if low is not None:
        return f"larger({value}, {number(low)})"
    return value if high is None else f"smaller({value}, {number(high)})"


def _held(model: Model, look_up: LookUp, axis: int) -> str:
    """Return an argument, clamped if the function has a narrower range than the table."""
    argument = look_up.arguments[axis]
    points = look_up.table.coordinates(axis)
    low = argument.low if argument.extrapolate in ("neither", "max") else None
    high = argument.high if argument.extrapolate in ("neither", "min") else None
    if look_up.table.points is None:  # A table on grids is constant beyond its ends.
        low = None if low is None or low <= points[0] else low
        high = None if high is None or high >= points[-1] else high
    value = _limited(model.variables[argument.variable].key, low, None)
    return _limited(value, None, high)


def _tables(model: Model) -> tuple[list[Line], dict[str, str]]:
    """Return the lines of breakpoints and tables, and the table name for each variable."""
    taken = {*TAKEN, *(variable.key for variable in model.variables.values())}
    definitions: dict[str, Line] = {}
    functions: dict[str, str] = {}

    def add(expected: str, value: str, comment: str = "") -> str:
        key = free_name(expected, taken)
        while key in definitions and definitions[key].text != f"{key} = {value}":
            key += "_"
        definitions.setdefault(key, Line(f"{key} = {value}", comment))
        return key

    for identifier, variable in model.variables.items():
        look_up = variable.look_up
        if look_up is None:
            continue
        table = look_up.table
        name = table.name if table.name.lower().endswith("table") else f"{table.name}_table"
        if table.points is None:
            arguments = [add(f"GRID_{grid}", sequence(points)) for grid, points in table.grids]
            arguments.append(sequence(table.values))
            ends = tuple(argument.extrapolate for argument in look_up.arguments)
            if set(ends) != {"neither"}:  # A function that extrapolates has its own table.
                arguments.append(f"extrapolate={ends!r}")
                name = f"{name}_to_{'_'.join(ends)}"
            value = call("table", arguments)
        else:
            value = call("scattered", map(sequence, (table.points, table.values)))
        functions[identifier] = add(name, value, f"{look_up.name}: {look_up.title}")
    return list(definitions.values()), functions


def _docstring(model: Model) -> str:
    lines = ["Outputs in the units of the file.", ""]
    for variable in model.inputs:
        text = f"{variable.key}: {variable.words}"
        lines += textwrap.wrap(text, WIDTH, initial_indent=INDENT, subsequent_indent=2 * INDENT)
    return "\n".join([*lines, INDENT]) if model.inputs else "The outputs."


def make_function(model: Model) -> Callable[..., Any]:
    """Return the model as a Python function that returns a named tuple of outputs."""
    source = UserSource(write_model(model), str(model.path))
    function: Callable[..., Any] = run_module(source).names[MODEL]
    return function


def run_shots(model: Model) -> None:
    """Run all check shots, including internal values with a tolerance.

    Raise InputErrors with all differences from the expected values.
    """
    checked = {signal.identifier for shot in model.shots for signal in shot.outputs}
    variables = {
        key: replace(v, is_output=v.is_output or key in checked)
        for key, v in model.variables.items()
    }
    if model.shots and (errors := [*_differences(replace(model, variables=variables))]):
        raise InputErrors(errors)


def _differences(model: Model) -> Iterator[InputError]:
    function = make_function(model)
    for shot in model.shots:
        inputs = {
            v.key: shot.inputs[v.identifier] for v in model.inputs if v.identifier in shot.inputs
        }
        missing = [v.name for v in model.inputs if v.initial is None and v.key not in inputs]
        if missing:
            yield InputError(
                model.path,
                f"the check shot '{shot.name}' lacks {quoted(missing)}",
                "a value for each input",
                shot.line,
            )
            continue
        outputs = function(**inputs)
        for signal in shot.outputs:
            value = float(getattr(outputs, model.variables[signal.identifier].key))
            # The condition is also true for NaN.
            if not abs(value - signal.value) <= signal.tolerance:
                yield InputError(
                    model.path,
                    f"'{signal.identifier}' is {value!r} in the check shot '{shot.name}'",
                    f"{signal.value!r} with a tolerance of {signal.tolerance!r}",
                    signal.line,
                )
