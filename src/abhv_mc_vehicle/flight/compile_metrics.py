"""Translation of metrics into instructions for the simulation kernel.

Expressions are parsed, never evaluated as Python.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.flights.expressions import SourceRow, compile_expression, compile_formula
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.signals import Source
from abhv_mc.flights.statistic import Operation, Statistic
from abhv_mc.io.messages import Refusal, counted
from abhv_mc_vehicle.flight.channels import SOURCES, effector_sources, state_channels
from abhv_mc_vehicle.kernel.flight.counting import MAX_LEAN, MAX_PROGRAMS, Counted, Lean, Programs
from abhv_mc_vehicle.kernel.flight.observe import find_row
from abhv_mc_vehicle.kernel.laws.user import CHANNEL, MAX_CHANNELS

MOST_CHANNELS = MAX_CHANNELS  # maximum number of custom channels
_LEAN_EMPTY = {  # initial values of the accumulators of lean metrics
    Statistic.MIN: math.inf,
    Statistic.MAX: -math.inf,
    **dict.fromkeys(
        (Statistic.MAX_ABS, Statistic.RMS, Statistic.FINAL, Statistic.SUM, Statistic.TIME_OUTSIDE),
        0.0,
    ),
}


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
    numbered = [
        (index, program)
        for index, metric in enumerate(metrics)
        for program in list_programs([metric])
    ]
    lean = [entry for entry in numbered if _is_lean(entry[1], sources)][:MAX_LEAN]
    full = [entry for entry in numbered if entry not in lean]
    lean_metrics, program_metrics = ([metric for _, metric in group] for group in (lean, full))
    rows = [sources[metric.of] for metric in lean_metrics]
    if len(full) > MAX_PROGRAMS:
        raise Refusal(f"found {counted(len(full), 'metric')}", f"at most {MAX_PROGRAMS}")
    programs = [compile_expression(metric.of, sources) for metric in program_metrics]
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
            column=np.array([index for index, _ in lean], np.int64),
            **_fields(lean_metrics, "statistic", "empty", "settled"),
        ),
        Programs(
            code=np.array(
                [line for program in programs for line in program.code], np.int64
            ).reshape(-1, 4),
            constant=np.array(
                [value for program in programs for value in program.constant], np.float64
            ),
            first=np.cumsum([0, *(len(program.code) for program in programs)], dtype=np.int64),
            factor=factors,
            column=np.array([index for index, _ in full], np.int64),
            **_fields(program_metrics, "statistic", "limit", "start", "end", "settled", "empty"),
        ),
    )


def list_programs(metrics: Iterable[Metric]) -> list[Metric]:
    """Return the metrics, with each formula replaced by the sources that the kernel samples."""
    return [
        replace(metric, of=of, statistic=min(metric.statistic, Statistic.QUANTILE))
        for metric in metrics
        for of in (
            compile_formula(metric.of).sources
            if metric.statistic == Statistic.ROBUSTNESS
            else [metric.of]
        )
    ]


def count_sampled(metrics: Iterable[Metric]) -> int:
    """Return the number of values that the kernel samples at each control tick."""
    return sum(program.statistic == Statistic.QUANTILE for program in list_programs(metrics))


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
