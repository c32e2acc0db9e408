"""Expressions and formulas of channels, which are parsed and never evaluated as Python.

Formulas are those of signal temporal logic. The value of a formula is its robustness, which is
positive if the formula is true and negative if it is false (Donze and Maler, 2010, "Robust
satisfaction of temporal logic over real-valued signals").
"""

import ast
import math
import re
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flights.robustness import find_maximum, find_minimum, find_steps, find_until
from abhv_mc.flights.statistic import MAX_REGISTERS, Operation
from abhv_mc.io.messages import Refusal, describe, found_value, one_of
from abhv_mc.io.units import NUMBER


class SourceRow(NamedTuple):
    """Row of the lane memory that contains a source, with its unit."""

    unit: str
    row: int  # index of the row
    factor: float
    nonnegative: bool = False


# temporal operators without an interval, and operators between two formulas
_UNLIMITED = re.compile(r"\b(always|eventually|until)\b(?!\s*\[)")
_INFIX = re.compile(r"\b(implies|until *\[.*?\])")


def compile_expression(
    text: str, sources: Mapping[str, SourceRow], rate: float = 0.0
) -> "Expression":
    """Compile an expression, or a formula for samples at ``rate`` Hz if it is positive.

    Raise Refusal if the text is invalid.
    """
    plain = text.strip()
    if rate:  # Infix operators become elements of a Python tuple; 1e999 is infinite.
        plain = _INFIX.sub(r", \1 ,", _UNLIMITED.sub(r"\1[0, 1e999]", plain))
    expression = Expression(sources, plain, rate)
    try:
        if rate and not re.search("[<>]", text):
            raise SyntaxError
        body = ast.parse(expression.text, mode="eval").body
        expression.add(body, 0)
    except (
        SyntaxError,
        RecursionError,
        MemoryError,
        OverflowError,
    ):  # The last three exceptions are caused by deep nesting or long numbers.
        expected = _FORMULA if rate else "a channel or an expression of channels"
        raise Refusal(found_value(text), expected) from None
    match body:
        case ast.Name(name):
            expression.nonnegative = sources[name].nonnegative
        case ast.Call(ast.Name("abs" | "sqrt")):
            expression.nonnegative = True
    return expression


class _NumberedSources(dict[str, SourceRow]):
    """Sources that are numbered in the order of their first use."""

    def __contains__(self, name: object) -> bool:
        return True

    def __missing__(self, name: str) -> SourceRow:
        return self.setdefault(name, SourceRow("-", len(self), 1.0))


def compile_formula(text: str, rate: float = 1.0) -> "Expression":
    """Compile a valid formula for samples of its ``sources``, which are numbered."""
    return compile_expression(text, _NumberedSources(), rate)


class Expression:
    """Instructions that evaluate an expression of sources."""

    def __init__(self, sources: Mapping[str, SourceRow], text: str, rate: float) -> None:
        self.sources, self.text, self.rate = sources, text, rate
        self.code: list[tuple[int, int, int, int]] = []
        self.constant: list[float] = []
        self.nonnegative = False  # whether the value of the expression is never negative
        self.named: dict[str, int] = {}  # registers of named values, from the last one down

    def _emit(
        self, operation: Operation, register: int, a: int = 0, b: int = 0, constant: float = 0.0
    ) -> None:
        self.code.append((int(operation), register, a, b))
        self.constant.append(constant)

    def add(self, node: ast.expr, register: int) -> None:
        """Emit code that stores the value of a node in a register.

        Only higher registers are overwritten. Raise Refusal if the node is not allowed.
        """
        if register >= MAX_REGISTERS - len(self.named):
            raise Refusal(
                "the expression is nested too deeply",
                f"at most {MAX_REGISTERS} intermediate values",
            )
        match node:
            case ast.NamedExpr(ast.Name(name), value):
                self.add(value, register)
                own = self.named.setdefault(name, MAX_REGISTERS - 1 - len(self.named))
                self._emit(Operation.MINIMUM, own, register, register)
            case ast.Name(name) if name in self.named:
                self._emit(Operation.MINIMUM, register, self.named[name], self.named[name])
            case ast.Name() | ast.Attribute(
                ast.Name()
            ):  # Expressions refer to custom states as state.NAME.
                name = ast.unparse(node)
                if name not in self.sources:
                    raise Refusal(f"unknown channel '{name}'", one_of(self.sources, name))
                self._emit(
                    Operation.LOAD,
                    register,
                    self.sources[name].row,
                    constant=self.sources[name].factor,
                )
            case ast.Constant(int() | float() as value) if not isinstance(value, bool):
                literal = str(ast.get_source_segment(self.text, node))
                if not (re.fullmatch(NUMBER, literal) and math.isfinite(value)):
                    raise Refusal(
                        f"invalid number {describe(literal)}",
                        "a decimal number, such as 0.5 or 1e3",
                    )
                self._emit(Operation.CONSTANT, register, constant=float(value))
            case ast.UnaryOp(ast.UAdd(), operand):
                self.add(operand, register)
            case ast.UnaryOp(ast.USub(), operand):
                self._emit(Operation.CONSTANT, register)
                self.add(operand, register + 1)
                self._emit(Operation.SUBTRACT, register, register, register + 1)
            case ast.BinOp(left, operator, right) if type(operator) in _OPERATORS:
                self._combine(_OPERATORS[type(operator)], register, left, right)
            case ast.Call(ast.Name("min" | "max" as name), [_, _, *_] as arguments, []):
                self._combine(_OPERATORS[name], register, *arguments)
            case ast.Call(ast.Name("sin" | "cos" as name), [ast.Name(angle)], []) if (
                angle in self.sources and self.sources[angle].unit == "deg"
            ):
                raise Refusal(
                    f"{name}({angle}) has an argument in degrees",
                    f"radians: {name}({angle} * 0.017453292519943295)",
                )
            case ast.Call(ast.Name(name), [argument], []) if name in FUNCTIONS or (
                self.rate and name == "step"
            ):
                self.add(argument, register)
                self._emit(FUNCTIONS.get(name, Operation.STEP), register, register, register)
            case _ if self.rate:
                self._add_formula(node, register)
            case _:
                raise Refusal(
                    f"'{ast.unparse(node):.60}' is not allowed in an expression",
                    "channels, numbers, + - * / abs min max sqrt sin cos",
                )

    def _combine(self, operation: Operation, register: int, *nodes: ast.expr) -> None:
        """Emit code that applies an operation to the values of nodes, from the left."""
        self.add(nodes[0], register)
        for node in nodes[1:]:
            self.add(node, register + 1)
            self._emit(operation, register, register, register + 1)

    def _add_formula(self, node: ast.expr, register: int) -> None:
        """Emit code for a node that only formulas have, like :meth:`add`."""
        match node:
            case ast.Tuple([formula]):
                self.add(formula, register)
            case ast.BoolOp(operator, formulas):
                self._combine(_OPERATORS[type(operator)], register, *formulas)
            case ast.Compare(low, [ast.Lt() | ast.LtE()], [high]) | ast.Compare(
                high, [ast.Gt() | ast.GtE()], [low]
            ):
                self._combine(Operation.SUBTRACT, register, high, low)
            case ast.Tuple([condition, ast.Name("implies"), *formulas]):
                negation = ast.UnaryOp(ast.USub(), condition)
                self._combine(Operation.MAXIMUM, register, negation, ast.Tuple(formulas))
            case ast.Tuple([before, ast.Subscript(ast.Name("until"), window), *formulas]):
                self.add(before, register)
                self.add(ast.Tuple(formulas), register + 1)
                self._emit(Operation.UNTIL, register, register, *self._count(window))
            case ast.Call(
                ast.Subscript(ast.Name("always" | "eventually" as name), window), formulas, []
            ):
                self.add(ast.Tuple(formulas), register)
                self._emit(Operation[name.upper()], register, register, *self._count(window))
            case _:
                raise Refusal(f"'{ast.unparse(node):.60}' is not allowed in a formula", _FORMULA)

    def _count(self, window: ast.expr) -> tuple[int, float]:
        """Return an interval in samples."""
        match window:
            case ast.Tuple(
                [ast.Constant(int() | float() as begin), ast.Constant(int() | float() as end)]
            ) if begin <= end:
                return math.ceil(begin * self.rate - 1e-6), end * self.rate + 1e-6
        raise Refusal(f"invalid interval {ast.unparse(window)}", "two times in s, such as [0, 5]")

    def evaluate(self, rows: Floats) -> Floats:
        """Return the value [row] for each row of the sources [row, source].

        Factors of sources are not applied. The rows of formulas are the samples of one flight.
        """
        registers: dict[int, Floats] = {}
        with np.errstate(all="ignore"):  # A result that is not finite ends the flight.
            for (operation, out, a, b), constant in zip(self.code, self.constant, strict=True):
                if operation == Operation.LOAD:
                    registers[out] = rows[:, a]
                elif operation == Operation.CONSTANT:
                    registers[out] = np.full(len(rows), constant)
                elif operation == Operation.UNTIL:
                    registers[out] = find_until(registers[a], registers[a + 1], b, constant)
                elif operation in _AHEAD:
                    registers[out] = _AHEAD[Operation(operation)](registers[a], b, constant)
                else:
                    registers[out] = _ACTIONS[Operation(operation)](registers[a], registers[b])
        return registers[0]

    def find_robustness(self, samples: Floats, empty: float) -> float:
        """Return the robustness of a formula for the samples [sample, source] of a flight.

        The result is ``empty`` if the samples do not determine the robustness.
        """
        value = float(self.evaluate(samples)[0]) if len(samples) else math.inf
        return empty if math.isinf(value) else value


_FORMULA = (
    "comparisons with < or >, joined by and, or, implies, always[a, b](...), "
    "eventually[a, b](...), until[a, b], with times a and b in s"
)
_OPERATORS: dict[object, Operation] = {
    ast.Add: Operation.ADD,
    ast.Sub: Operation.SUBTRACT,
    ast.Mult: Operation.MULTIPLY,
    ast.Div: Operation.DIVIDE,
    **dict.fromkeys((ast.And, "min"), Operation.MINIMUM),
    **dict.fromkeys((ast.Or, "max"), Operation.MAXIMUM),
}
FUNCTIONS = {
    "abs": Operation.ABSOLUTE,
    "sqrt": Operation.ROOT,
    "sin": Operation.SINE,
    "cos": Operation.COSINE,
}

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
    Operation.STEP: lambda a, _: find_steps(a),
}
_AHEAD = {Operation.ALWAYS: find_minimum, Operation.EVENTUALLY: find_maximum}
