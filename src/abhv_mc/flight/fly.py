"""Fly a plan under many dispersions: the one place where Python enters the compiled flight."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats, Singles
from abhv_mc.flight.arguments import Kept, make_kernel_plan, make_results
from abhv_mc.flight.lost import fly_in_child, open_memory
from abhv_mc.flight.plan import (
    NOT_LEAN,
    FlightBlock,
    FlightPlan,
    Recording,
    join_blocks,
    recording_of,
)
from abhv_mc.flight.user_law import must_fly_elsewhere, open_law
from abhv_mc.kernel.flight.counting import Statistic
from abhv_mc.kernel.flight.fly_lanes import make_fly_lanes
from abhv_mc.kernel.flight.interface import LANES, KernelResults
from abhv_mc.kernel.flight.memory import Memory, make_memory
from abhv_mc.kernel.jit import is_kept
from abhv_mc.kernel.plant.state import N_PARAMETERS
from abhv_mc.plant.parameters import PARAMETERS
from abhv_mc.user_code.child import in_child

_SAMPLED = 512  # flights at once where quantiles keep every tick: 25 MB each in a minute
_LONGEST = 600.0  # s that flights of native code may take up to where they are kept

_NOT_LEAN = np.array([parameter.name.startswith(NOT_LEAN) for parameter in PARAMETERS])
compiled_flight: Callable[[int], Any] = cache(make_fly_lanes)


@cache
def choose_flight(lanes: int, lean: bool) -> Any:
    """The compiled flight that serves: the full one where the cache has it."""
    full = compiled_flight(lanes)
    return make_fly_lanes(lanes, lean=True) if lean and not is_kept(full) else full


def nominal_parameters(flights: int = 1) -> Floats:
    """Undispersed parameters, ``[flight, parameter]``."""
    return np.tile([parameter.nominal for parameter in PARAMETERS], (flights, 1))


def make_block(plan: FlightPlan, results: KernelResults, recording: Recording) -> FlightBlock:
    """Filled results as what :func:`fly` returns."""
    tick = plan.timing.tick
    end_time = np.asarray(results.end_tick * tick, dtype=np.float64)
    times = np.asarray(
        np.arange(results.history.shape[1]) * recording.every * tick, dtype=np.float64
    )
    block = FlightBlock(
        results.outcome, end_time, results.metrics, results.history, times, results.states
    )
    if not recording.extremes:
        return block
    low, high = join_bins(results.low, results.high, results.history)
    return replace(block, low=low, high=high)


def fly(
    plan: FlightPlan,
    parameters: Floats,
    record_every: Recording | int | None = None,
    lanes: int = LANES,
    keep_states: bool = False,
    start: Kept | None = None,
) -> FlightBlock:
    """Fly every row of ``parameters`` [flight, parameter] (order of PARAMETERS); threads may call it side by side.

    ``record_every``: what is recorded, or control ticks between samples of every channel; ``keep_states`` adds the
    whole state. A flight depends on its row and the plan alone, not on ``lanes`` or other rows. ``start``: flights of
    ``fly_until`` that go on, with NaN before it. Raises ValueError for an array of the wrong type or shape.
    """
    recording = recording_of(record_every, plan)
    if must_fly_elsewhere(plan):
        return fly_in_child(
            fly, plan, parameters, recording, lanes, keep_states=keep_states, start=start
        )
    sampled = any(metric.statistic == Statistic.QUANTILE for metric in plan.metrics)
    if sampled and len(parameters) > _SAMPLED and not keep_states and start is None:
        starts = range(0, len(parameters), _SAMPLED)
        return join_blocks(
            [fly(plan, parameters[i : i + _SAMPLED], recording, lanes) for i in starts]
        )
    results = make_results(plan, len(parameters), recording, keep_states)
    with open_memory(lanes, len(parameters), plan.timing.tick) as memory:
        fly_in_memory(plan, parameters, results, recording, memory, start=start)
    return make_block(plan, results, recording)


def fly_until(plan: FlightPlan, parameters: Floats, tick: int, start: Kept | None = None) -> Kept:
    """Fly up to a control tick, from ``start`` where it is given, and keep what the kernel knows of each flight.

    Of a flight that ended before, nothing is promised but that its lane is no longer alive. Raises InputError for a law
    in plain Python whose memory is no named tuple of numbers.
    """
    if must_fly_elsewhere(plan):
        return in_child(fly_until, plan, parameters, tick, start, limit=_LONGEST)
    shorter = replace(plan, timing=plan.timing._replace(ticks=tick))
    results = make_results(shorter, len(parameters), Recording(0), False, keep=True)
    fly_in_memory(
        shorter,
        parameters,
        results,
        Recording(0),
        make_memory(LANES),
        start=start,
        memory_in_rows=True,
    )
    return Kept(tick, results.kept)


def fly_in_memory(
    plan: FlightPlan,
    parameters: Floats,
    results: KernelResults,
    recording: Recording,
    memory: Memory,
    *,
    start: Kept | None = None,
    memory_in_rows: bool = False,
) -> None:
    """Fill the results. Raises ValueError, see :mod:`abhv_mc.flight.arguments`; ``memory_in_rows``: of a user law."""
    if plan.lean and not np.array_equal(
        parameters[:, : _NOT_LEAN.size][:, _NOT_LEAN],
        nominal_parameters(len(parameters))[:, _NOT_LEAN],
    ):
        raise ValueError("parameters of a lean flight disperse what it does not know")
    kernel_plan = make_kernel_plan(plan, parameters, recording, start)
    width = memory.Z.shape[1]
    in_rows = memory_in_rows or start is not None
    foreign = plan.vehicle.foreign
    settings = N_PARAMETERS + foreign.settings.size + foreign.states
    dispersed = kernel_plan.parameters.shape[1] > settings
    with open_law(plan, width, in_rows, len(parameters), dispersed) as user_code:
        choose_flight(width, plan.lean)(kernel_plan._replace(user_code=user_code), memory, results)
    fill_quantiles(plan, results, complete=start is None)


def fill_quantiles(plan: FlightPlan, results: KernelResults, complete: bool) -> None:
    """Fill in metrics that are quantiles over the ticks that counted (numpy's ``linear``), where there are any."""
    quantiles = [
        (i, metric.limit)
        for i, metric in enumerate(plan.metrics)
        if metric.statistic == Statistic.QUANTILE
    ]
    for (place, share), samples in zip(quantiles, results.samples, strict=True):
        values = results.metrics[:, place]
        for flight in np.flatnonzero(np.isfinite(values)):
            seen = samples[flight][~np.isnan(samples[flight])]
            if seen.size:
                values[flight] = np.quantile(seen, share) if complete else np.nan


def join_bins(low: Floats, high: Floats, history: Singles) -> tuple[Singles, Singles]:
    """Extremes ``[sample, channel]`` from the sample before to the one after each; NaN where nobody flew, and -0 is 0.

    low, high: of each bin, the first above the second where there was no value; history: [flight, sample, channel].
    """
    seen = low <= high
    return _join(np.where(seen, low, np.nan), history, np.fmin), _join(
        np.where(seen, high, np.nan), history, np.fmax
    )


def _join(bins: Floats, history: Singles, extreme: np.ufunc) -> Singles:
    after = bins.astype(np.float32)
    found = after.copy()
    if len(history):
        found[:-1] = extreme(after[:-1], extreme.reduce(history[:, 1:], axis=0))
    found[1:] = extreme(found[1:], after[:-1])
    return np.asarray(found + np.float32(0.0), np.float32)
