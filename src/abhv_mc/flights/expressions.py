"""Expressions of channels, which are parsed and never evaluated as Python."""

import ast
import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from abhv_mc.flights.statistic import MAX_REGISTERS, Operation
from abhv_mc.io.messages import Refusal, describe, found_value, one_of
from abhv_mc.io.units import NUMBER


class SourceRow(NamedTuple):
    """Row of the lane memory that contains a source, with its unit."""

    unit: str
    row: int  # index of the row
    factor: float
    nonnegative: bool = False


def compile_expression(text: str, sources: Mapping[str, SourceRow]) -> "Expression":
    """Compile an expression. Raise Refusal if it is invalid."""
    expression = Expression(sources, text.strip())
    try:
        body = ast.parse(expression.text, mode="eval").body
        expression.add(body, 0)
    except (
        SyntaxError,
        RecursionError,
        MemoryError,
        OverflowError,
    ):  # The last three exceptions are caused by deep nesting or long numbers.
        raise Refusal(found_value(text), "a channel or an expression of channels") from None
    is_nonnegative_source = isinstance(body, ast.Name) and sources[body.id].nonnegative
    is_magnitude = (
        isinstance(body, ast.Call)
        and isinstance(body.func, ast.Name)
        and body.func.id in ("abs", "sqrt")
    )
    expression.nonnegative = is_nonnegative_source or is_magnitude
    return expression


class Expression:
    """Instructions that evaluate an expression of sources."""

    def __init__(self, sources: Mapping[str, SourceRow], text: str) -> None:
        self.sources, self.text = sources, text
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
            case ast.NamedExpr(target=ast.Name(id=name), value=value):
                self.add(value, register)
                own = self.named.setdefault(name, MAX_REGISTERS - 1 - len(self.named))
                self._emit(Operation.MINIMUM, own, register, register)
            case ast.Name(id=name) if name in self.named:
                self._emit(Operation.MINIMUM, register, self.named[name], self.named[name])
            case (
                ast.Name() | ast.Attribute(value=ast.Name())
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
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                literal = str(ast.get_source_segment(self.text, node))
                if not (re.fullmatch(NUMBER, literal) and math.isfinite(value)):
                    raise Refusal(
                        f"invalid number {describe(literal)}",
                        "a decimal number, such as 0.5 or 1e3",
                    )
                self._emit(Operation.CONSTANT, register, constant=float(value))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                self.add(operand, register)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                self._emit(Operation.CONSTANT, register)
                self.add(operand, register + 1)
                self._emit(Operation.SUBTRACT, register, register, register + 1)
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
                self.add(left, register)
                self.add(right, register + 1)
                self._emit(_OPERATORS[type(operator)], register, register, register + 1)
            case ast.Call(
                func=ast.Name(id=("min" | "max") as name), args=[head, *remaining], keywords=[]
            ) if remaining:
                self.add(head, register)
                for argument in remaining:
                    self.add(argument, register + 1)
                    operation = Operation.MINIMUM if name == "min" else Operation.MAXIMUM
                    self._emit(operation, register, register, register + 1)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in FUNCTIONS
            ):
                angle = (
                    name in ("sin", "cos")
                    and isinstance(argument, ast.Name)
                    and self.sources.get(argument.id)
                )
                if angle and angle.unit == "deg":
                    raise Refusal(
                        f"{name}({ast.unparse(argument)}) has an argument in degrees",
                        f"radians: {name}({ast.unparse(argument)} * 0.017453292519943295)",
                    )
                self.add(argument, register)
                self._emit(FUNCTIONS[name], register, register, register)
            case _:
                raise Refusal(
                    f"'{ast.unparse(node):.60}' is not allowed in an expression",
                    "channels, numbers, + - * / abs min max sqrt sin cos",
                )


_OPERATORS = {
    ast.Add: Operation.ADD,
    ast.Sub: Operation.SUBTRACT,
    ast.Mult: Operation.MULTIPLY,
    ast.Div: Operation.DIVIDE,
}
FUNCTIONS = {
    "abs": Operation.ABSOLUTE,
    "sqrt": Operation.ROOT,
    "sin": Operation.SINE,
    "cos": Operation.COSINE,
}
