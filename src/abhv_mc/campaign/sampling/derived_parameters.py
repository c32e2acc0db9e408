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
from abhv_mc.flights.expressions import SourceRow, compile_expression
from abhv_mc.flights.parameters import Parameters
from abhv_mc.flights.statistic import Operation
from abhv_mc.io.messages import Refusal

_SIN = (
    -0.16666666666666666,
    0.008333333333330948,
    -0.00019841269836758574,
    2.755731610255244e-06,
    -2.5051131845003624e-08,
    1.5918129294866608e-10,
)
_COS = (
    0.041666666666666664,
    -0.0013888888888887398,
    2.480158729876569e-05,
    -2.7557317271729793e-07,
    2.08761462684032e-09,
    -1.1382632425521717e-11,
)
_HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
_TWO_OVER_PI = 0.6366197723675814
_ROUND = 6755399441055744.0  # Adding 1.5 * 2^52 rounds a number to an integer.
_LIMIT = 1048576.0  # largest magnitude for an exact reduction, rad


def sine(x: Floats, quarter: int = 0) -> Floats:
    """Return the sine of x + ``quarter`` pi/2; NaN for magnitudes of x beyond 2^20 rad.

    The result has the bits of the compiled code on every processor. The method and the constants
    are those of :func:`abhv_mc_vehicle.kernel.numerics.lane_math.sincos`.
    """
    x = np.where(np.abs(x) <= _LIMIT, x, np.nan)
    n = (x * _TWO_OVER_PI + _ROUND) - _ROUND
    a, b = x - n * _HALF_PI[0], -(n * _HALF_PI[1])
    c = a + b
    increment = c - a
    tail = ((a - (c - increment)) + (b - increment)) - n * _HALF_PI[2]
    r = c + tail
    tail = (c - r) + tail
    z = r * r
    z2, half_z, r3 = z * z, 0.5 * z, z * r
    s = (_SIN[1] + z * _SIN[2]) + z2 * ((_SIN[3] + z * _SIN[4]) + z2 * _SIN[5])
    of_sine = r - ((z * (0.5 * tail - r3 * s) - tail) - r3 * _SIN[0])
    c = (_COS[0] + z * _COS[1]) + z2 * ((_COS[2] + z * _COS[3]) + z2 * (_COS[4] + z * _COS[5]))
    w = 1.0 - half_z
    of_cosine = w + (((1.0 - w) - half_z) + (z2 * c - r * tail))
    quadrant = (np.nan_to_num(n).astype(np.int64) + quarter) & 3
    values = np.where(quadrant & 1, of_cosine, of_sine)
    return np.asarray(np.where(quadrant & 2, -values, values), dtype=np.float64)


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
