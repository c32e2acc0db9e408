"""Inputs that follow from others, such as a drag factor that goes with lift: computed last, from a flight's row.

They are no dimension of the samples: what is drawn, stored, searched, re-weighted and shrunk is what they are made of.
Expressions are those of metrics, of parameters in SI; they are parsed into instructions and never run as Python.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.compile_metrics import Known, compile_expression
from abhv_mc.io.input_error import Refusal
from abhv_mc.kernel.flight.counting import Operation
from abhv_mc.kernel.numerics.lane_math import sincos
from abhv_mc.plant.parameters import OURS, Parameters

DOTTED = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?:\.\w+)+")  # a parameter's name, and no number
_DOT = "__"  # in an expression's names, which have none
_sincos = np.vectorize(sincos, otypes=(float, float))  # the same bits on every processor
_ACTIONS: dict[Operation, Callable[[Floats, Floats], Floats]] = {
    Operation.ADD: np.add,
    Operation.SUBTRACT: np.subtract,
    Operation.MULTIPLY: np.multiply,
    Operation.DIVIDE: np.divide,
    Operation.MINIMUM: np.minimum,
    Operation.MAXIMUM: np.maximum,
    Operation.ABSOLUTE: lambda a, _: np.abs(a),
    Operation.ROOT: lambda a, _: np.sqrt(a),
    Operation.SINE: lambda a, _: _sincos(a)[0],
    Operation.COSINE: lambda a, _: _sincos(a)[1],
}


@dataclass(frozen=True)
class DerivedInput:
    """A parameter and the instructions that make it."""

    name: str
    of: frozenset[str]  # parameters
    code: tuple[tuple[int, int, int, int], ...]
    constants: tuple[float, ...]

    def evaluate(self, rows: Floats) -> Floats:
        """Its values ``[flight]`` of full rows ``[flight, parameter]``, SI."""
        found: dict[int, Floats] = {}
        with np.errstate(all="ignore"):  # what is no number ends the flight
            for (operation, out, a, b), constant in zip(self.code, self.constants, strict=True):
                if operation == Operation.LOAD:
                    found[out] = rows[:, a]
                elif operation == Operation.CONSTANT:
                    found[out] = np.full(len(rows), constant)
                else:
                    found[out] = _ACTIONS[Operation(operation)](found[a], found[b])
        return found[0]


Derived = tuple[DerivedInput, ...]


def compile_derived(name: str, text: str, parameters: Parameters = OURS) -> DerivedInput:
    """The instructions of a derived input. Raises Refusal."""
    index = parameters.index
    known = {
        each.replace(".", _DOT): Known(parameters[each].unit, index[each], 1.0)
        for each in parameters.dispersible
    }
    try:
        made = compile_expression(
            DOTTED.sub(lambda found: found[0].replace(".", _DOT), text), known
        )
    except Refusal as refusal:
        found, expected = (
            words.replace(_DOT, ".").replace("channel", "parameter")
            for words in (refusal.found, refusal.expected)
        )
        raise Refusal(found, expected) from None
    names = frozenset(
        parameters.records[a].name
        for operation, _, a, _ in made.code
        if operation == Operation.LOAD
    )
    return DerivedInput(name, names, tuple(made.code), tuple(made.constant))


def derive(rows: Floats, derived: Derived, parameters: Parameters = OURS) -> None:
    """Put derived inputs into full rows ``[flight, parameter]``: each from what the rows held before."""
    values = [each.evaluate(rows) for each in derived]
    for each, value in zip(derived, values, strict=True):
        rows[:, parameters.index[each.name]] = value
