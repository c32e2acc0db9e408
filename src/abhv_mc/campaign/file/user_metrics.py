"""Metrics that a campaign declares: their entries, and the program that the compiled flight counts them by.

An expression is parsed into instructions and never evaluated as Python.
"""

import ast
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, RootModel, model_validator

from abhv_mc.flight.channels import CHANNEL_INDEX, CHANNELS, METRIC_INDEX
from abhv_mc.flight.declared import (
    MAX_METRICS,
    MAX_REGISTERS,
    DeclaredMetrics,
    DeclaredStatistic,
    Operation,
    make_declared,
)
from abhv_mc.flight.observe import find_factor, find_row
from abhv_mc.io.documents import Document, InputError, Refusal, StrictModel, describe, one_of, read_document, validate
from abhv_mc.io.unit_pattern import NUMBER
from abhv_mc.io.units import Time
from abhv_mc.user_code.source import compile_text, read_source

StatisticName = Literal[
    "min", "max", "max_abs", "mean", "rms", "final", "integral", "peak_to_peak", "travel", "time_outside",
    "last_outside", "first_outside", "reversals",
]  # fmt: skip
_NEEDS_LIMIT = ("time_outside", "last_outside", "first_outside")
_TAKES_LIMIT = (*_NEEDS_LIMIT, "reversals")
_TAKEN = {"flight", "controller", "outcome", "end_time_s", *METRIC_INDEX}
_UNITS = {"deg": "deg", "dps": "deg/s", "mps": "m/s", "m": "m", "s": "s", "kg": "kg", "g": "g", "pa": "Pa", "n": "N"}


class MetricEntry(StrictModel):
    """A metric of the campaign's own."""

    of: str = Field(description="a channel, or an expression of channels: + - * / abs min max sqrt sin cos")
    statistic: StatisticName = Field(description="what is made of it over the control ticks of the window")
    limit: Annotated[float, Field(ge=0.0)] | None = Field(
        None, description="in the unit of 'of': for *_outside, or the least turn of reversals"
    )
    from_: Time = Field(0.0, alias="from", description="the window's start")
    to: Time | None = Field(None, description="the window's end; by default the flight's")
    settled: bool = Field(False, description="leave out 5 s after each step of the reference")
    unit: str | None = Field(None, description="of the metric, where the channel and the name do not say it")
    doc: str = Field("", description="what it means, for the report")

    @model_validator(mode="after")
    def _check(self) -> "MetricEntry":
        if self.statistic in _NEEDS_LIMIT and self.limit is None:
            raise Refusal(f"'{self.statistic}' without 'limit'", "a limit in the unit of 'of'")
        if self.limit is not None and self.statistic not in _TAKES_LIMIT:
            raise Refusal(f"a limit with '{self.statistic}'", f"it with {', '.join(_TAKES_LIMIT)}", ("limit",))
        if self.to is not None and self.to <= self.from_:
            raise Refusal("an empty window", "'from' before 'to'", ("to",))
        return self


MetricName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)]


class MetricsFile(RootModel[dict[MetricName, MetricEntry]]):
    """A file of metrics."""


class Channel(NamedTuple):
    """What an expression may name."""

    unit: str
    row: int  # of the lane memory
    factor: float


def known_channels(own: Iterable[tuple[str, str]] = ()) -> dict[str, Channel]:
    """The channels of the program, and those of the user's own file, each (name, unit)."""
    from abhv_mc.control.laws.user import CHANNEL

    known = {c.name: Channel(c.unit, find_row(c.source), find_factor(c.source, c.unit)) for c in CHANNELS}
    return known | {name: Channel(unit, CHANNEL + i, 1.0) for i, (name, unit) in enumerate(own)}


def read_metrics_file(path: Path) -> tuple[Document, dict[str, MetricEntry]]:
    """A file of metrics. Raises InputError."""
    document = read_document(path)
    return document, validate(document, MetricsFile).root


def compile_metrics(
    entries: dict[str, MetricEntry],
    channels: dict[str, Channel],
    document: Document,
    where: tuple[str, ...],
    errors: list[InputError],
) -> DeclaredMetrics:
    """The declared metrics as the flight counts them; what is wrong is added to ``errors``."""
    code: list[tuple[int, int, int, int]] = []
    constant: list[float] = []
    first, rows, words = [0], [], []
    if len(entries) > MAX_METRICS:
        errors.append(document.key_error(where, f"{len(entries)} metrics", f"at most {MAX_METRICS}"))
        entries = dict(list(entries.items())[:MAX_METRICS])
    for name, entry in entries.items():
        if name in _TAKEN:
            found = f"'{name}', a metric of the program"
            errors.append(document.key_error((*where, name), found, "another name"))
        program = _Program(channels, entry.of.strip())
        try:
            program.add(ast.parse(program.text, mode="eval").body, 0)
        except (SyntaxError, RecursionError, MemoryError, OverflowError):  # the last three: deep nesting, long numbers
            wanted = "a channel or an expression of channels"
            errors.append(document.error((*where, name, "of"), describe(entry.of), wanted))
        except Refusal as refusal:
            errors.append(document.error((*where, name, "of"), refusal.found, refusal.wanted))
        code += program.code
        constant += program.constant
        first.append(len(code))
        end = np.inf if entry.to is None else entry.to
        statistic = DeclaredStatistic[entry.statistic.upper()]
        rows.append((int(statistic), entry.limit or 0.0, entry.from_, end, int(entry.settled)))
        words.append((name, _unit(name, entry, channels), entry.doc or _describe(entry)))
    names, units, docs = (np.array([row[i] for row in words], dtype=np.str_) for i in range(3))
    return DeclaredMetrics(names, units, docs, make_declared(code, constant, first, rows))


class _Program:
    """Instructions for one expression."""

    def __init__(self, channels: dict[str, Channel], text: str) -> None:
        self.channels, self.text = channels, text
        self.code: list[tuple[int, int, int, int]] = []
        self.constant: list[float] = []

    def _emit(self, operation: Operation, register: int, a: int = 0, b: int = 0, constant: float = 0.0) -> None:
        self.code.append((int(operation), register, a, b))
        self.constant.append(constant)

    def add(self, node: ast.expr, register: int) -> None:
        """The value of a node into a register; those above it are free. Raises Refusal."""
        if register >= MAX_REGISTERS:
            raise Refusal("an expression that is nested too deeply", f"at most {MAX_REGISTERS} values at once")
        match node:
            case ast.Name(id=name):
                if name not in self.channels:
                    raise Refusal(f"channel '{name}'", one_of(self.channels, name))
                channel = self.channels[name]
                self._emit(Operation.LOAD, register, channel.row, constant=channel.factor)
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                written = str(ast.get_source_segment(self.text, node))
                if not (re.fullmatch(NUMBER, written) and math.isfinite(value)):
                    raise Refusal(f"number {describe(written)}", "a plain decimal one, such as 0.5 or 1e3")
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
            case ast.Call(func=ast.Name(id=("min" | "max") as name), args=[head, *others], keywords=[]) if others:
                self.add(head, register)
                for other in others:
                    self.add(other, register + 1)
                    operation = Operation.MINIMUM if name == "min" else Operation.MAXIMUM
                    self._emit(operation, register, register, register + 1)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in _FUNCTIONS:
                if name in ("sin", "cos") and isinstance(argument, ast.Name):
                    channel_unit = self.channels.get(argument.id, Channel("", 0, 0.0)).unit
                    if channel_unit == "deg":
                        found = f"{name}({argument.id}), which is in degrees"
                        raise Refusal(found, f"radians: {name}({argument.id} * 0.017453292519943295)")
                self.add(argument, register)
                self._emit(_FUNCTIONS[name], register, register, register)
            case _:
                raise Refusal(f"'{ast.unparse(node):.60}'", "channels, numbers, + - * / abs min max sqrt sin cos")


_OPERATORS: dict[type[ast.operator], Operation] = {
    ast.Add: Operation.ADD,
    ast.Sub: Operation.SUBTRACT,
    ast.Mult: Operation.MULTIPLY,
    ast.Div: Operation.DIVIDE,
}
_FUNCTIONS = {
    "abs": Operation.ABSOLUTE,
    "sqrt": Operation.ROOT,
    "sin": Operation.SINE,
    "cos": Operation.COSINE,
}


def _unit(name: str, entry: MetricEntry, channels: dict[str, Channel]) -> str:
    """The unit of a metric: what the entry says, what its channel and statistic make, what its name ends with."""
    if entry.unit is not None:
        return entry.unit
    if entry.statistic in _NEEDS_LIMIT:
        return "s"
    if entry.statistic == "reversals":
        return "-"
    of = channels[entry.of.strip()].unit if entry.of.strip() in channels else _UNITS.get(name.rpartition("_")[2], "-")
    if entry.statistic != "integral" or entry.of.strip() not in channels:
        return of
    return {"W/m2": "J/m2", "-": "s", "m/s": "m", "deg/s": "deg"}.get(of, f"{of} s")


def _describe(entry: MetricEntry) -> str:
    """A metric in words."""
    words = f"{entry.statistic.replace('_', ' ')} of {entry.of}"
    if entry.limit is not None:
        words += f", limit {entry.limit:g}"
    if entry.from_ or entry.to is not None:
        words += f", from {entry.from_:g} s" + (f" to {entry.to:g} s" if entry.to is not None else "")
    return words + (", settled stretches only" if entry.settled else "")


def find_own_channels(path: Path) -> tuple[tuple[str, str], ...]:
    """Name and unit of each ``@channel`` of a file, found in its text: the file is not run. Raises InputError."""
    tree = compile_text(read_source(path), ast.PyCF_ONLY_AST)
    found: list[tuple[str, str]] = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            for mark in node.decorator_list:
                if isinstance(mark, ast.Call) and isinstance(mark.func, ast.Name) and mark.func.id == "channel":
                    units = [word.value for word in mark.keywords if word.arg == "unit"]
                    if len(units) != 1 or not isinstance(units[0], ast.Constant):
                        raise InputError(path, mark.lineno, None, "@channel without a unit", '@channel(unit="deg")')
                    if node.name in CHANNEL_INDEX or node.name in _FUNCTIONS or node.name in ("min", "max"):
                        found_name = f"'{node.name}', a name of the program"
                        raise InputError(path, node.lineno, None, found_name, "another name")
                    found.append((node.name, str(units[0].value)))
    if not found:
        raise InputError(path, None, None, "no function with @channel", 'one: @channel(unit="deg")')
    return tuple(found)
