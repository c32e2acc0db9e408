"""Derived inputs: parameters computed from other parameters of the same flight.

An example is a drag factor that depends on the lift factor. Derived inputs are computed from the
drawn parameters and are not a dimension of the samples: only their operands are drawn, stored,
searched and re-weighted. Expressions have the syntax of metrics, with parameters in SI units; they
are parsed into instructions and never run as Python.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.sines import sine
from abhv_mc.flights.expressions import SourceRow, compile_expression
from abhv_mc.flights.parameters import Parameters
from abhv_mc.flights.statistic import Operation
from abhv_mc.io.input_error import Refusal

DOTTED = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?:\.\w+)+")  # matches parameter names but not numbers
_DOT = "__"  # replacement for dots, which identifiers cannot contain
_ACTIONS: dict[Operation, Callable[[Floats, Floats], Floats]] = {
    Operation.ADD: np.add,
    Operation.SUBTRACT: np.subtract,
    Operation.MULTIPLY: np.multiply,
    Operation.DIVIDE: np.divide,
    Operation.MINIMUM: np.minimum,
    Operation.MAXIMUM: np.maximum,
    Operation.ABSOLUTE: lambda a, _: np.abs(a),
    Operation.ROOT: lambda a, _: np.sqrt(a),
    Operation.SINE: lambda a, _: sine(a),
    Operation.COSINE: lambda a, _: sine(a, 1),
}


@dataclass(frozen=True)
class DerivedInput:
    """Derived parameter with the instructions that compute it."""

    name: str
    of: frozenset[str]  # names of the operands
    code: tuple[tuple[int, int, int, int], ...]
    constants: tuple[float, ...]

    def evaluate(self, rows: Floats) -> Floats:
        """Return the derived values [flight] in SI, computed from full rows [flight, parameter]."""
        registers: dict[int, Floats] = {}
        with np.errstate(all="ignore"):  # A result that is not finite ends the flight.
            for (operation, out, a, b), constant in zip(self.code, self.constants, strict=True):
                if operation == Operation.LOAD:
                    registers[out] = rows[:, a]
                elif operation == Operation.CONSTANT:
                    registers[out] = np.full(len(rows), constant)
                else:
                    registers[out] = _ACTIONS[Operation(operation)](registers[a], registers[b])
        return registers[0]


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
    return DerivedInput(name, names, tuple(compiled.code), tuple(compiled.constant))


def derive(rows: Floats, derived: Derived, parameters: Parameters) -> None:
    """Set the derived inputs in full rows [flight, parameter].

    All values are computed from the original rows before any of them is set.
    """
    values = [derived_input.evaluate(rows) for derived_input in derived]
    for derived_input, value in zip(derived, values, strict=True):
        rows[:, parameters.index[derived_input.name]] = value
