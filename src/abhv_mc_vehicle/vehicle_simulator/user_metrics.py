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
from abhv_mc.campaign.file.systems import Response
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
    unit_of,
)
from abhv_mc.flights.statistic import MAX_DECLARED, Statistic
from abhv_mc.io.documents import Document, StrictModel
from abhv_mc.io.messages import InputError, Refusal, found_value, one_of
from abhv_mc.io.units import Fraction, Time
from abhv_mc_vehicle.control.design.profile import step_times
from abhv_mc_vehicle.control.mission import Mission
from abhv_mc_vehicle.flight.channels import SOURCES
from abhv_mc_vehicle.flight.compile_metrics import MOST_CHANNELS, list_programs, source_rows
from abhv_mc_vehicle.flight.metrics import BUILT_IN, effector_metrics

_STEPPED = "transients, or a reference channel of altitude, speed, path angle or heading with steps"
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


def _statistic(value: Any) -> Any:
    if value not in STATISTICS:
        raise Refusal(found_value(value), one_of(STATISTICS, value))
    return Statistic[value.upper()]


class MetricEntry(StrictModel):
    """Metric declared in a campaign file."""

    of: str
    """channel, or expression of channels with + - * / abs min max sqrt sin cos; for robustness, a
    formula"""
    statistic: Annotated[
        Statistic, BeforeValidator(_statistic, json_schema_input_type=Literal[STATISTICS])
    ] = Statistic.ROBUSTNESS
    """statistic of the quantity in 'of' over the control ticks of the time window; default:
    robustness"""
    response: Response | None = None
    """short form of a formula: response of the quantity in 'of' to the steps of a reference"""
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
        is_formula = self.statistic == Statistic.ROBUSTNESS
        is_quantile = self.statistic == Statistic.QUANTILE
        uses = {
            "limit": self.statistic in TAKES_LIMIT,
            "share": is_quantile,
            "settled": not is_formula,
            "response": is_formula,
        }
        for key, is_used in uses.items():
            if key in self.model_fields_set and not is_used:
                problem = f"the statistic '{self.statistic.word}' does not use '{key}'"
                raise Refusal(problem, f"no key '{key}', or another statistic", (key,))
        if is_quantile and self.share is None:
            raise Refusal("the statistic 'quantile' needs a share", "a share such as 95 %")
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
    mission: Mission | None = None,
    effectors: tuple[str, ...] = (),
    states: tuple[tuple[str, str, bool], ...] = (),
) -> tuple[Metric, ...]:
    """Return the records of the declared metrics; append problems to ``errors``.

    ``effectors`` are the effectors with actuators; ``mission`` defines phases and steps.
    """
    sources = source_rows(pack_sources(user_channels), effectors, states)
    taken = _TAKEN | {metric.name for metric in effector_metrics(effectors)}
    records = []
    for name, entry in entries.items():
        if name in taken:
            errors.append(
                document.key_error(
                    (*where, name), f"the name '{name}' is reserved by the program", "another name"
                )
            )
        try:
            records.append(_record(name, entry, sources, mission))
        except Refusal as refusal:
            keys = refusal.keys or ("of",)
            errors.append(document.error((*where, name, *keys), refusal.found, refusal.expected))
    if (count := len(list_programs(records))) > MAX_DECLARED:
        problem = f"found {count} metrics and channels of formulas"
        errors.append(document.key_error(where, problem, f"at most {MAX_DECLARED}"))
    return tuple(records)


def pack_sources(user_channels: Sequence[tuple[str, str]]) -> NDArray[np.str_]:
    """Return the names and units [channel, 2] of custom channels as stored in plans."""
    return np.array(user_channels, np.str_).reshape(-1, 2)


def _record(
    name: str, entry: MetricEntry, sources: Mapping[str, SourceRow], mission: Mission | None
) -> Metric:
    """Return the record of a declared metric. Raise Refusal if its entry is invalid."""
    statistic, of = entry.statistic, entry.of.strip()
    windows = mission.windows() if mission else {}
    window = entry.from_, np.inf if entry.to is None else entry.to
    if entry.phase is not None and entry.phase not in windows:
        expected = one_of(windows, entry.phase) if windows else "a phase of the mission"
        raise Refusal(f"unknown phase '{entry.phase}'", expected, ("phase",))
    if entry.phase is not None:
        window = windows[entry.phase]
    unit = _unit(name, entry, sources)
    if mission and (response := entry.response):
        last = min(window[1], mission.duration) - response.within
        steps = [time for time in step_times(mission, response.to) if window[0] <= time <= last]
        if not steps:
            problem = f"'{response.to}' has no step from {window[0]:g} to {last:g} s"
            raise Refusal(problem, _STEPPED, ("response", "to"))
        of = response.write_formula(of, unit, [time - window[0] for time in steps])
    rate = float(statistic == Statistic.ROBUSTNESS)
    nonnegative = compile_expression(of, sources, rate).nonnegative
    record = Metric(
        name=name,
        unit=unit,
        doc=entry.doc,
        label=entry.label or label_of(name, unit),
        bad=entry.bad or default_bad(statistic),
        group="user",
        of=of,
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
        return unit_of(name)
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
        for mark in node.decorator_list if isinstance(node, ast.FunctionDef) else ():
            match mark:
                case ast.Call(ast.Name("channel"), _, [ast.keyword("unit", ast.Constant(unit))]):
                    if node.name in (*SOURCES, *FUNCTIONS, "min", "max"):
                        problem = f"the name '{node.name}' is reserved by the program"
                        raise InputError(path, problem, "another name", node.lineno)
                    if len(channels) == MOST_CHANNELS:
                        expected = f"at most {MOST_CHANNELS} custom channels"
                        raise InputError(path, "found another channel", expected, node.lineno)
                    channels.append((node.name, str(unit)))
                case ast.Call(ast.Name("channel")):
                    problem = "the decorator @channel has no unit"
                    raise InputError(path, problem, '@channel(unit="deg")', mark.lineno)
    if not channels:
        raise InputError(
            path,
            "no function with @channel",
            'at least one function with a decorator such as @channel(unit="deg")',
        )
    return tuple(channels)
