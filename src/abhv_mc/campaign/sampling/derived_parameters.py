"""Derived inputs: parameters computed from other parameters of the same flight.

An example is a drag factor that depends on the lift factor. Derived inputs are computed from the
drawn parameters and are not a dimension of the samples: only their operands are drawn, stored,
searched and re-weighted. Expressions have the syntax of metrics, with parameters in SI units; they
are parsed into instructions and never run as Python.
"""

import re
from dataclasses import dataclass

from abhv_mc.array_types import Floats
from abhv_mc.flights.expressions import Expression, SourceRow, compile_expression
from abhv_mc.flights.parameters import Parameters
from abhv_mc.flights.statistic import Operation
from abhv_mc.io.messages import Refusal

DOTTED = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?:\.\w+)+")  # matches parameter names but not numbers
_DOT = "__"  # replacement for dots, which identifiers cannot contain


@dataclass(frozen=True)
class DerivedInput:
    """Derived parameter with the program that computes it in SI from full rows."""

    name: str
    of: frozenset[str]  # names of the operands
    program: Expression


Derived = tuple[DerivedInput, ...]


def compile_derived(name: str, text: str, parameters: Parameters) -> DerivedInput:
    """Compile the expression of a derived input. Raise Refusal for an invalid expression."""
    index = parameters.index
    sources = {
        parameter.replace(".", _DOT): SourceRow(parameters[parameter].unit, index[parameter], 1.0)
        for parameter in parameters.dispersible
    }
    try:
        compiled = compile_expression(
            DOTTED.sub(lambda problem: problem[0].replace(".", _DOT), text), sources
        )
    except Refusal as refusal:
        problem, expected = (
            text_part.replace(_DOT, ".").replace("channel", "parameter")
            for text_part in (refusal.found, refusal.expected)
        )
        raise Refusal(problem, expected) from None
    names = frozenset(
        parameters.records[a].name
        for operation, _, a, _ in compiled.code
        if operation == Operation.LOAD
    )
    return DerivedInput(name, names, compiled)


def derive(rows: Floats, derived: Derived, parameters: Parameters) -> None:
    """Set the derived inputs in full rows [flight, parameter].

    All values are computed from the original rows before any of them is set.
    """
    values = [derived_input.program.evaluate(rows) for derived_input in derived]
    for derived_input, value in zip(derived, values, strict=True):
        rows[:, parameters.index[derived_input.name]] = value
