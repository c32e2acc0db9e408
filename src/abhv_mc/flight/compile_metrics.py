"""Metrics as numbers that the compiled flight follows; an expression is parsed, and never evaluated as Python."""

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
from abhv_mc.io.input_error import Refusal, describe, one_of
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

_LEAN_EMPTY = {  # what the accumulator of a lean metric starts from
    Statistic.MIN: math.inf,
    Statistic.MAX: -math.inf,
    **dict.fromkeys(
        (Statistic.MAX_ABS, Statistic.RMS, Statistic.FINAL, Statistic.SUM, Statistic.TIME_OUTSIDE),
        0.0,
    ),
}


class Known(NamedTuple):
    """A source as expressions name it."""

    unit: str
    row: int  # of the lane memory
    factor: float
    nonnegative: bool = False


def _find(source: Source) -> Known:
    """Rows are in SI and radians, derived quantities in their own unit; ``effector_at+3`` is the fourth of its rows."""
    name, _, place = source.source.partition("+")
    as_it_stands = source.unit not in ("deg", "deg/s") or name.endswith("_deg")
    factor = 1.0 if as_it_stands else 180.0 / math.pi
    return Known(source.unit, find_row(name) + int(place or 0), factor, source.nonnegative)


@cache
def _known_sources(
    effectors: tuple[str, ...], states: tuple[tuple[str, str], ...]
) -> dict[str, Known]:
    sources = *SOURCES.values(), *effector_sources(effectors), *state_channels(states)
    return {each.name: _find(each) for each in sources}


def known_sources(
    user_channels: NDArray[np.str_],
    effectors: tuple[str, ...] = (),
    states: tuple[tuple[str, str], ...] = (),
) -> dict[str, Known]:
    """The sources of the program, of ``effectors`` with actuators and custom ``states`` (names and units).

    Behind them user channels [channel, 2], names and units.
    """
    if len(user_channels) > MAX_CHANNELS:
        raise ValueError(f"{len(user_channels)} channels of the user's own")
    return _known_sources(effectors, states) | {
        name: Known(unit, CHANNEL + i, 1.0) for i, (name, unit) in enumerate(user_channels.tolist())
    }


def compile_metrics(metrics: Sequence[Metric], known: Mapping[str, Known]) -> Counted:
    """The metrics as the flight counts them. Raises Refusal for an expression that makes no sense."""
    lean = [place for place, metric in enumerate(metrics) if _is_lean(metric, known)][:MAX_LEAN]
    others = [place for place in range(len(metrics)) if place not in lean]
    if len(others) > MAX_PROGRAMS:
        raise Refusal(f"{len(others)} metrics", f"at most {MAX_PROGRAMS}")
    rows = [known[metrics[place].of] for place in lean]
    chosen = [metrics[place] for place in lean]
    programs = [compile_expression(metrics[place].of, known) for place in others]
    rest = [metrics[place] for place in others]
    factors = np.ones(len(rest))
    for i, (metric, program) in enumerate(zip(rest, programs, strict=True)):
        if metric.statistic == Statistic.TRAVEL and [line[0] for line in program.code] == [
            Operation.LOAD
        ]:
            factors[i], program.constant[0] = (
                program.constant[0],
                1.0,
            )  # after the difference: as exact as it gets
    return Counted(
        Lean(
            row=np.array([each.row for each in rows], np.int64),
            factor=np.array([each.factor for each in rows], np.float64),
            place=np.array(lean, np.int64),
            **_fields(chosen, "statistic", "empty", "settled"),
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
            place=np.array(others, np.int64),
            **_fields(rest, "statistic", "limit", "start", "end", "settled", "empty"),
        ),
    )


def _fields(metrics: Sequence[Metric], *names: str) -> dict[str, NDArray[Any]]:
    """These fields of metrics, [metric]."""
    kinds = {"statistic": np.int64, "settled": np.int64}
    return {
        name: np.array([getattr(m, name) for m in metrics], kinds.get(name, np.float64))
        for name in names
    }


def _is_lean(metric: Metric, known: Mapping[str, Known]) -> bool:
    """Whether a metric of the program's is one row over the whole flight, which one accumulator counts as well."""
    if (
        metric.group == "user"
        or metric.of not in known
        or metric.start > 0.0
        or metric.end < math.inf
    ):
        return False
    nonnegative = known[metric.of].nonnegative
    if metric.statistic == Statistic.TIME_OUTSIDE and not (nonnegative and metric.limit == 0.0):
        return False
    same = metric.empty == _LEAN_EMPTY.get(metric.statistic)
    grows = metric.statistic == Statistic.MAX and metric.empty == 0.0 and nonnegative
    return (same and not (metric.settled and metric.statistic != Statistic.MAX_ABS)) or (
        grows and not metric.settled
    )


def compile_expression(text: str, known: Mapping[str, Known]) -> "Expression":
    """The program of an expression. Raises Refusal."""
    made = Expression(known, text.strip())
    try:
        body = ast.parse(made.text, mode="eval").body
        made.add(body, 0)
    except (
        SyntaxError,
        RecursionError,
        MemoryError,
        OverflowError,
    ):  # the last three: deep nesting, long numbers
        raise Refusal(describe(text), "a channel or an expression of channels") from None
    single = isinstance(body, ast.Name) and known[body.id].nonnegative
    size = (
        isinstance(body, ast.Call)
        and isinstance(body.func, ast.Name)
        and body.func.id in ("abs", "sqrt")
    )
    made.nonnegative = single or size
    return made


class Expression:
    """Instructions for one expression."""

    def __init__(self, known: Mapping[str, Known], text: str) -> None:
        self.known, self.text = known, text
        self.code: list[tuple[int, int, int, int]] = []
        self.constant: list[float] = []
        self.nonnegative = False  # whether it is never below zero

    def _emit(
        self, operation: Operation, register: int, a: int = 0, b: int = 0, constant: float = 0.0
    ) -> None:
        self.code.append((int(operation), register, a, b))
        self.constant.append(constant)

    def add(self, node: ast.expr, register: int) -> None:
        """The value of a node into a register; those above it are free. Raises Refusal."""
        if register >= MAX_REGISTERS:
            raise Refusal(
                "an expression that is nested too deeply", f"at most {MAX_REGISTERS} values at once"
            )
        match node:
            case ast.Name() | ast.Attribute(value=ast.Name()):  # a custom state is state.NAME
                name = ast.unparse(node)
                if name not in self.known:
                    raise Refusal(f"unknown channel '{name}'", one_of(self.known, name))
                self._emit(
                    Operation.LOAD, register, self.known[name].row, constant=self.known[name].factor
                )
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                written = str(ast.get_source_segment(self.text, node))
                if not (re.fullmatch(NUMBER, written) and math.isfinite(value)):
                    raise Refusal(
                        f"number {describe(written)}", "a plain decimal one, such as 0.5 or 1e3"
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
                func=ast.Name(id=("min" | "max") as name), args=[head, *others], keywords=[]
            ) if others:
                self.add(head, register)
                for other in others:
                    self.add(other, register + 1)
                    operation = Operation.MINIMUM if name == "min" else Operation.MAXIMUM
                    self._emit(operation, register, register, register + 1)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in FUNCTIONS
            ):
                angle = (
                    name in ("sin", "cos")
                    and isinstance(argument, ast.Name)
                    and self.known.get(argument.id)
                )
                if angle and angle.unit == "deg":
                    found = f"{name}({ast.unparse(argument)}), which is in degrees"
                    raise Refusal(
                        found, f"radians: {name}({ast.unparse(argument)} * 0.017453292519943295)"
                    )
                self.add(argument, register)
                self._emit(FUNCTIONS[name], register, register, register)
            case _:
                raise Refusal(
                    f"'{ast.unparse(node):.60}'",
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
