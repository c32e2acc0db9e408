"""Translation of metrics into instructions for the simulation kernel.

Expressions are parsed, never evaluated as Python.
"""

import ast
import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.flight.channels import SOURCES, Source, effector_sources, state_channels
from abhv_mc.flight.metrics import Metric
from abhv_mc.io.input_error import Refusal, describe, found_value, one_of
from abhv_mc.io.phrases import counted
from abhv_mc.io.units import NUMBER
from abhv_mc.kernel.flight.counting import (
    MAX_LEAN,
    MAX_PROGRAMS,
    MAX_REGISTERS,
    Counted,
    Lean,
    Operation,
    Programs,
    Statistic,
)
from abhv_mc.kernel.flight.observe import find_row
from abhv_mc.kernel.laws.user import CHANNEL, MAX_CHANNELS

MOST_CHANNELS = MAX_CHANNELS  # maximum number of custom channels
_LEAN_EMPTY = {  # initial values of the accumulators of lean metrics
    Statistic.MIN: math.inf,
    Statistic.MAX: -math.inf,
    **dict.fromkeys(
        (Statistic.MAX_ABS, Statistic.RMS, Statistic.FINAL, Statistic.SUM, Statistic.TIME_OUTSIDE),
        0.0,
    ),
}


class SourceRow(NamedTuple):
    """Row of the lane memory that contains a source, with its unit."""

    unit: str
    row: int  # index of the row
    factor: float
    nonnegative: bool = False


def _make_row(source: Source) -> SourceRow:
    """Return the row of a source; ``effector_at+3`` is the fourth row of ``effector_at``.

    Rows of derived quantities are in the source's unit, other rows in SI units and radians.
    """
    name, _, offset = source.source.partition("+")
    is_in_unit = source.unit not in ("deg", "deg/s") or name.endswith("_deg")
    factor = 1.0 if is_in_unit else 180.0 / math.pi
    return SourceRow(source.unit, find_row(name) + int(offset or 0), factor, source.nonnegative)


@cache
def _builtin_source_rows(
    effectors: tuple[str, ...], states: tuple[tuple[str, str, bool], ...]
) -> dict[str, SourceRow]:
    all_sources = *SOURCES.values(), *effector_sources(effectors), *state_channels(states)
    return {source.name: _make_row(source) for source in all_sources}


def source_rows(
    user_channels: NDArray[np.str_],
    effectors: tuple[str, ...] = (),
    states: tuple[tuple[str, str, bool], ...] = (),
) -> dict[str, SourceRow]:
    """Return the lane-memory rows of all sources, by name.

    The sources are the built-in ones and those of ``effectors`` with actuators, custom ``states``
    (names and units), and custom channels [channel, 2] (names and units).
    """
    return _builtin_source_rows(effectors, states) | {
        name: SourceRow(unit, CHANNEL + i, 1.0)
        for i, (name, unit) in enumerate(user_channels.tolist())
    }


def compile_metrics(metrics: Sequence[Metric], sources: Mapping[str, SourceRow]) -> Counted:
    """Compile metrics for the kernel. Raise Refusal if an expression is invalid."""
    lean_indices = [index for index, metric in enumerate(metrics) if _is_lean(metric, sources)][
        :MAX_LEAN
    ]
    program_indices = [index for index in range(len(metrics)) if index not in lean_indices]
    if len(program_indices) > MAX_PROGRAMS:
        raise Refusal(f"found {counted(len(program_indices), 'metric')}", f"at most {MAX_PROGRAMS}")
    rows = [sources[metrics[index].of] for index in lean_indices]
    lean_metrics = [metrics[index] for index in lean_indices]
    programs = [compile_expression(metrics[index].of, sources) for index in program_indices]
    program_metrics = [metrics[index] for index in program_indices]
    factors = np.ones(len(program_metrics))
    for i, (metric, program) in enumerate(zip(program_metrics, programs, strict=True)):
        if metric.statistic == Statistic.TRAVEL and [line[0] for line in program.code] == [
            Operation.LOAD
        ]:
            factors[i], program.constant[0] = (
                program.constant[0],
                1.0,
            )  # Units are converted after taking the difference, to avoid rounding errors.
    return Counted(
        Lean(
            row=np.array([row.row for row in rows], np.int64),
            factor=np.array([row.factor for row in rows], np.float64),
            column=np.array(lean_indices, np.int64),
            **_fields(lean_metrics, "statistic", "empty", "settled"),
        ),
        Programs(
            code=np.array(
                [line for program in programs for line in program.code], dtype=np.int64
            ).reshape(-1, 4),
            constant=np.array(
                [value for program in programs for value in program.constant], np.float64
            ),
            first=np.cumsum([0, *(len(program.code) for program in programs)], dtype=np.int64),
            factor=factors,
            column=np.array(program_indices, np.int64),
            **_fields(program_metrics, "statistic", "limit", "start", "end", "settled", "empty"),
        ),
    )


def _fields(metrics: Sequence[Metric], *names: str) -> dict[str, NDArray[Any]]:
    """Return the fields of metrics as arrays [metric]."""
    kinds = {"statistic": np.int64, "settled": np.int64}
    return {
        name: np.array([getattr(m, name) for m in metrics], kinds.get(name, np.float64))
        for name in names
    }


def _is_lean(metric: Metric, sources: Mapping[str, SourceRow]) -> bool:
    """Return whether a metric is a statistic of one row that needs only one accumulator."""
    if (
        metric.group == "user"
        or metric.of not in sources
        or metric.start > 0.0
        or metric.end < math.inf
    ):
        return False
    nonnegative = sources[metric.of].nonnegative
    if metric.statistic == Statistic.TIME_OUTSIDE and not (nonnegative and metric.limit == 0.0):
        return False
    starts_alike = metric.empty == _LEAN_EMPTY.get(metric.statistic)
    grows = metric.statistic == Statistic.MAX and metric.empty == 0.0 and nonnegative
    return (starts_alike and not (metric.settled and metric.statistic != Statistic.MAX_ABS)) or (
        grows and not metric.settled
    )


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
                    actual = f"{name}({ast.unparse(argument)}) has an argument in degrees"
                    raise Refusal(
                        actual, f"radians: {name}({ast.unparse(argument)} * 0.017453292519943295)"
                    )
                self.add(argument, register)
                self._emit(FUNCTIONS[name], register, register, register)
            case _:
                raise Refusal(
                    f"'{ast.unparse(node):.60}' is not allowed in an expression",
                    "channels, numbers, + - * / abs min max sqrt sin cos",
                )


_OPERATORS: dict[type[ast.operator], Operation] = {
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
