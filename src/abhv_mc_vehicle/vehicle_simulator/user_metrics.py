"""Metrics and custom channels declared in a campaign file."""

import ast
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, RootModel, model_validator

from abhv_mc.campaign.file.config import MetricName
from abhv_mc.custom_code.source import compile_text, read_source
from abhv_mc.flights.expressions import FUNCTIONS, SourceRow, compile_expression
from abhv_mc.flights.metrics import (
    MARGIN_FAULTS,
    NEEDS_LIMIT,
    TAKES_LIMIT,
    Bad,
    Metric,
    default_bad,
    is_never_negative,
    label_of,
    name_end,
)
from abhv_mc.flights.statistic import MAX_DECLARED, Statistic
from abhv_mc.io.documents import Document, StrictModel
from abhv_mc.io.messages import InputError, Refusal, counted, found_value, one_of, quoted
from abhv_mc.io.units import Fraction, Time
from abhv_mc_vehicle.flight.channels import SOURCES
from abhv_mc_vehicle.flight.compile_metrics import MOST_CHANNELS, source_rows
from abhv_mc_vehicle.flight.metrics import BUILT_IN, effector_metrics

STATISTICS = tuple(statistic.word for statistic in Statistic)
_TAKEN = {
    "flight",
    "controller",
    "outcome",
    "end_time_s",
    "reason",
    *BUILT_IN,
    *(signal.name for signal in MARGIN_FAULTS),
}
# Units with which names of metrics may end; longer suffixes precede shorter ones.
_NAMED_UNITS = ("J/m2", "W/m2", "m/s", "deg/s", "deg", "kg", "Pa", "m", "s", "g", "N", "J")


def _statistic(value: Any) -> Any:
    if value not in STATISTICS:
        raise Refusal(found_value(value), one_of(STATISTICS, value))
    return Statistic[value.upper()]


class MetricEntry(StrictModel):
    """Metric declared in a campaign file."""

    of: str
    """channel, or expression of channels with + - * / abs min max sqrt sin cos"""
    statistic: Annotated[
        Statistic, BeforeValidator(_statistic, json_schema_input_type=Literal[STATISTICS])
    ]
    """statistic of the quantity in 'of' over the control ticks of the time window"""
    limit: Annotated[float, Field(ge=0.0)] | None = None
    """limit for the *_outside statistics, or smallest change that counts as a reversal, in the
    unit of the quantity in 'of'"""
    share: Annotated[Fraction, Field(gt=0.0, lt=1.0)] | None = None
    """for quantile: share of the control ticks at which the value is at most the quantile"""
    from_: Time = Field(0.0, alias="from")
    """start of the time window"""
    to: Time | None = None
    """end of the time window; default: end of the flight"""
    phase: str | None = None
    """name of the mission phase that is used as the time window"""
    settled: bool = False
    """whether to exclude each ramp or step of the bank command and the 5 s after it"""
    empty: float | None = None
    """value of the metric if a flight ends before the time window; default: no value, which
    counts as a failure"""
    bad: Bad | None = None
    """which values are worse: high, low, or large in magnitude; default: low for min, else high"""
    unit: str | None = None
    """unit of the metric, if it does not follow from the channel or the name"""
    label: str | None = None
    """name of the metric in the report, without unit; default: the key"""
    doc: str = ""
    """description of the metric in the report"""

    @model_validator(mode="after")
    def _check(self) -> "MetricEntry":
        if self.statistic in NEEDS_LIMIT and self.limit is None:
            raise Refusal(
                f"the statistic '{self.statistic.word}' needs a limit",
                "'limit', in the unit of 'of'",
            )
        if self.limit is not None and self.statistic not in TAKES_LIMIT:
            raise Refusal(
                f"the statistic '{self.statistic.word}' does not use a limit",
                f"'limit' only with {quoted([statistic.word for statistic in TAKES_LIMIT], 'or')}",
                ("limit",),
            )
        if (self.share is None) == (self.statistic == Statistic.QUANTILE):
            problem = (
                "the statistic 'quantile' needs a share"
                if self.share is None
                else f"the statistic '{self.statistic.word}' does not use a share"
            )
            raise Refusal(
                problem, "a share such as 95 % if, and only if, the statistic is 'quantile'"
            )
        if self.to is not None and self.to <= self.from_:
            raise Refusal("the time window is empty", "'from' before 'to'", ("to",))
        if self.phase is not None and (self.from_ or self.to is not None):
            raise Refusal(
                "'phase' cannot be combined with 'from' and 'to'",
                "only one time window",
                ("phase",),
            )
        return self


class MetricsFile(RootModel[dict[MetricName, MetricEntry]]):
    """Content of a file that declares metrics."""


def declare_metrics(
    entries: dict[str, MetricEntry],
    user_channels: Sequence[tuple[str, str]],
    document: Document,
    where: tuple[str, ...],
    errors: list[InputError],
    *,
    windows: Mapping[str, tuple[float, float]],
    effectors: tuple[str, ...] = (),
    states: tuple[tuple[str, str, bool], ...] = (),
) -> tuple[Metric, ...]:
    """Return the records of the declared metrics; append problems to ``errors``.

    ``effectors`` are the effectors with actuators.
    """
    sources = source_rows(pack_sources(user_channels), effectors, states)
    taken = _TAKEN | {metric.name for metric in effector_metrics(effectors)}
    if len(entries) > MAX_DECLARED:
        errors.append(
            document.key_error(
                where, f"found {counted(len(entries), 'metric')}", f"at most {MAX_DECLARED}"
            )
        )
    records = []
    for name, entry in entries.items():
        if name in taken:
            errors.append(
                document.key_error(
                    (*where, name), f"the name '{name}' is reserved by the program", "another name"
                )
            )
        try:
            nonnegative = compile_expression(entry.of, sources).nonnegative
        except Refusal as refusal:
            errors.append(document.error((*where, name, "of"), refusal.found, refusal.expected))
            nonnegative = False
        window = entry.from_, np.inf if entry.to is None else entry.to
        if entry.phase is not None and entry.phase not in windows:
            expected = (
                one_of(windows, entry.phase)
                if windows
                else "a mission that has a phase with this name"
            )
            errors.append(
                document.error((*where, name, "phase"), f"unknown phase '{entry.phase}'", expected)
            )
        elif entry.phase is not None:
            window = windows[entry.phase]
        records.append(_record(name, entry, sources, nonnegative, window))
    return tuple(records)


def pack_sources(user_channels: Sequence[tuple[str, str]]) -> NDArray[np.str_]:
    """Return the names and units [channel, 2] of custom channels as stored in plans."""
    return np.array(user_channels, np.str_).reshape(-1, 2)


def _record(
    name: str,
    entry: MetricEntry,
    sources: Mapping[str, SourceRow],
    nonnegative: bool,
    window: tuple[float, float],
) -> Metric:
    unit = _unit(name, entry, sources)
    statistic = entry.statistic
    record = Metric(
        name=name,
        unit=unit,
        doc=entry.doc,
        label=entry.label or label_of(name, unit),
        bad=entry.bad or default_bad(statistic),
        group="user",
        of=entry.of.strip(),
        statistic=statistic,
        limit=entry.limit or entry.share or 0.0,
        start=window[0],
        end=window[1],
        settled=entry.settled,
        empty=np.nan if entry.empty is None else entry.empty,
        never_negative=is_never_negative(statistic, nonnegative),
    )
    return record if record.doc else replace(record, doc=record.counted)


def _unit(name: str, entry: MetricEntry, sources: Mapping[str, SourceRow]) -> str:
    """Return the unit of a metric from its entry, its channel and statistic, or its name."""
    if entry.unit is not None:
        return entry.unit
    if entry.statistic == Statistic.REVERSALS:
        return "-"
    if entry.statistic in NEEDS_LIMIT:
        return "s"
    source = sources.get(entry.of.strip())
    if source is None:
        return next((unit for unit in _NAMED_UNITS if name.endswith(f"_{name_end(unit)}")), "-")
    if entry.statistic != Statistic.INTEGRAL:
        return source.unit
    return {"W/m2": "J/m2", "-": "s", "m/s": "m", "deg/s": "deg"}.get(
        source.unit, f"{source.unit} s"
    )


def find_user_channels(path: Path) -> tuple[tuple[str, str], ...]:
    """Return the name and unit of each ``@channel`` function, without running the file.

    Raise InputError if a channel is invalid.
    """
    tree = compile_text(read_source(path), ast.PyCF_ONLY_AST)
    channels: list[tuple[str, str]] = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            for mark in node.decorator_list:
                if isinstance(mark, ast.Call) and getattr(mark.func, "id", "") == "channel":
                    units = [word.value for word in mark.keywords if word.arg == "unit"]
                    if len(units) != 1 or not isinstance(units[0], ast.Constant):
                        raise InputError(
                            path,
                            "the decorator @channel has no unit",
                            '@channel(unit="deg")',
                            mark.lineno,
                        )
                    if node.name in (*SOURCES, *FUNCTIONS, "min", "max"):
                        raise InputError(
                            path,
                            f"the name '{node.name}' is reserved by the program",
                            "another name",
                            node.lineno,
                        )
                    if len(channels) == MOST_CHANNELS:
                        raise InputError(
                            path,
                            "found another channel",
                            f"at most {MOST_CHANNELS} custom channels",
                            node.lineno,
                        )
                    channels.append((node.name, str(units[0].value)))
    if not channels:
        raise InputError(
            path,
            "no function with @channel",
            'at least one function with a decorator such as @channel(unit="deg")',
        )
    return tuple(channels)
