"""Simulation of the flights of a plan; only this module calls the simulation kernel.

Flights with native control laws run in a child process, which may crash.

The memory of a single flight is mapped to a file that remains after a crash, so that the last tick
can be reported.
"""

import contextlib
import math
import mmap
import os
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats, Singles
from abhv_mc.custom_code.child import LostError, in_child, may_run_here
from abhv_mc.flights.blocks import (
    FlightBlock,
    Recording,
    join_blocks,
    make_failed_block,
    make_recording,
)
from abhv_mc.flights.expressions import compile_formula
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.statistic import Statistic
from abhv_mc_vehicle.flight.arguments import SavedFlights, make_kernel_plan, make_results
from abhv_mc_vehicle.flight.compile_metrics import count_sampled
from abhv_mc_vehicle.flight.plan import NOT_LEAN, FlightPlan
from abhv_mc_vehicle.flight.user_law import PROCESS, open_law
from abhv_mc_vehicle.kernel.flight import observe
from abhv_mc_vehicle.kernel.flight.fly_lanes import make_fly_lanes
from abhv_mc_vehicle.kernel.flight.interface import (
    LANES,
    O_ROWS,
    Z_ROWS,
    KernelResults,
    Memory,
    make_memory,
)
from abhv_mc_vehicle.kernel.jit import is_cached
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import N_PARAMETERS
from abhv_mc_vehicle.plant.parameters import PARAMETERS
from abhv_mc_vehicle.user_code.law_interface import Measured, find_unit
from abhv_mc_vehicle.user_code.unpack import laws_folder

_LIMIT = 60.0  # time limit for each group of up to 16 flights, s
_FEW = 16
_ROWS = Z_ROWS + O_ROWS + 1  # number of rows of the file; the last row contains the control period
_compiled: set[int] = set()  # lane counts for which the child has loaded compiled flights


def fly_in_child(
    fly: Callable[..., FlightBlock],
    plan: FlightPlan,
    parameters: Floats,
    recording: Recording,
    lanes: int,
    *,
    keep_states: bool,
    start: SavedFlights | None = None,
) -> FlightBlock:
    """Call ``fly`` in the child process.

    If a single flight crashes the process or exceeds the time limit twice, its outcome states this.
    """
    if lanes not in _compiled:  # Compilation does not count towards the time limit.
        in_child(fly, plan, parameters[:0], recording, lanes, keep_states)
        _compiled.add(lanes)

    def attempt(rows: Floats) -> FlightBlock:
        limit = _LIMIT * max(1, -(-len(rows) // _FEW))
        return in_child(fly, plan, rows, recording, lanes, keep_states, start, limit=limit)

    try:
        return attempt(parameters)
    except LostError:
        if start is not None:
            raise
        if len(parameters) > 1:
            rows = (row[None] for row in parameters)
            return join_blocks(
                [
                    fly_in_child(fly, plan, row, recording, lanes, keep_states=keep_states)
                    for row in rows
                ]
            )
    try:
        return attempt(parameters)
    except LostError as error:
        reason = f"{error.words}{describe_last_tick(error.process)}"
        print(
            f"controller '{plan.controller}': the control law failed in a flight: {reason}",
            file=sys.stderr,
            flush=True,
        )
        outcome = plan.lost_outcome(error.hung)
        states = s.N_STATES if keep_states else 0
        block = make_failed_block(plan, outcome, recording, len(plan.metrics), states)
        return replace(block, reasons={0: reason})


@contextlib.contextmanager
def open_memory(width: int, flights: int, tick_length: float) -> Iterator[Memory]:
    """Yield memory for ``width`` lanes that is large enough for any vehicle.

    For a single flight in a process that may crash, the memory is mapped to a file.
    """
    if flights != 1 or width != LANES or not may_run_here():
        yield make_memory(width)
        return
    path = laws_folder() / f"flying_{os.getpid()}_{threading.get_native_id()}"
    with path.open("w+b") as file:
        file.truncate(8 * _ROWS * width)
        block = np.frombuffer(mmap.mmap(file.fileno(), 0)).reshape(_ROWS, width)
    block[-1] = tick_length
    try:
        yield make_memory(width)._replace(Z=block[:Z_ROWS], O=block[Z_ROWS:-1])
    finally:
        path.unlink(missing_ok=True)


def describe_last_tick(process: int | None) -> str:
    """Return a clause that names the last tick of a flight in a crashed process, or ''."""
    description = ""
    for path in laws_folder().glob(f"flying_{process}_*"):
        content = path.read_bytes()
        path.unlink()
        if len(content) != 8 * _ROWS * LANES:  # The process ended before the first tick.
            continue
        lane = np.frombuffer(content).reshape(_ROWS, LANES)[:, 0]
        tick = int(lane[Z_ROWS + observe.SAMPLES])
        names = Measured._fields[: s.N_MEASURED]
        values = lane[s.MEASURED : s.MEASURED + s.N_MEASURED].tolist()
        measured = [
            f"{name} {v:.9g} {find_unit(f'measured.{name}')}"
            for name, v in zip(names, values, strict=True)
        ]
        description = (
            f"; the last tick was {tick}, at {tick * lane[-1]:g} s, with the measurements "
            f"{', '.join(measured)}"
        )
    return description


_SAMPLED = 512  # number of flights per call times sampled signals; limits memory use
_LONGEST = 600.0  # time limit for fly_until with native code, s

_NOT_LEAN = np.array([parameter.name.startswith(NOT_LEAN) for parameter in PARAMETERS])
compiled_flight = cache(make_fly_lanes)


@cache
def choose_flight(lanes: int, lean: bool) -> Any:
    """Return the lean kernel if ``lean`` is true and the full kernel is not cached.

    Otherwise, return the full kernel.
    """
    full = compiled_flight(lanes)
    return make_fly_lanes(lanes, lean=True) if lean and not is_cached(full) else full


def nominal_parameters(flights: int = 1) -> Floats:
    """Return an array [flight, parameter] of nominal parameters."""
    return np.tile([parameter.nominal for parameter in PARAMETERS], (flights, 1))


def make_block(plan: FlightPlan, results: KernelResults, recording: Recording) -> FlightBlock:
    """Convert the results of the kernel to a block of flights."""
    tick = plan.timing.tick
    end_time = np.asarray(results.end_tick * tick, np.float64)
    times = np.asarray(np.arange(results.history.shape[1]) * recording.every * tick, np.float64)
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
    start: SavedFlights | None = None,
) -> FlightBlock:
    """Simulate one flight per row of ``parameters`` [flight, parameter].

    ``record_every`` is a Recording, or the number of control ticks between samples of all channels;
    ``keep_states`` also records the full state. A flight depends only on its row and the plan, not
    on ``lanes`` or other rows. If ``start`` is given, the flights saved by ``fly_until`` continue,
    and histories are NaN before that time. The function is thread-safe. Raise ValueError if an
    array has the wrong type or shape.
    """
    recording = make_recording(record_every, plan)
    if plan.must_run_in_child:
        return fly_in_child(
            fly, plan, parameters, recording, lanes, keep_states=keep_states, start=start
        )
    sampled = count_sampled(plan.metrics)
    flights = len(parameters)
    most = LANES if plan.law == PROCESS else _SAMPLED // sampled if sampled else flights
    if flights > most and not keep_states and start is None:
        starts = range(0, flights, most)
        return join_blocks([fly(plan, parameters[i : i + most], recording, lanes) for i in starts])
    results = make_results(plan, flights, recording, keep_states)
    with open_memory(lanes, flights, plan.timing.tick) as memory:
        fly_in_memory(plan, parameters, results, recording, memory, start=start)
    return make_block(plan, results, recording)


def fly_until(
    plan: FlightPlan, parameters: Floats, tick: int, start: SavedFlights | None = None
) -> SavedFlights:
    """Simulate flights up to a control tick and return the memory of each flight.

    Flights continue from ``start`` if it is given. The memory of a flight that ended earlier is
    undefined, except that it is marked as ended. Raise InputError for a control law in plain Python
    whose memory is not a named tuple of numbers.
    """
    if plan.must_run_in_child:
        return in_child(fly_until, plan, parameters, tick, start, limit=_LONGEST)
    shorter = replace(plan, timing=plan.timing._replace(ticks=tick))
    results = make_results(shorter, len(parameters), Recording(0), False, save_memory=True)
    fly_in_memory(
        shorter,
        parameters,
        results,
        Recording(0),
        make_memory(LANES),
        start=start,
        memory_in_rows=True,
    )
    return SavedFlights(tick, results.saved)


def fly_in_memory(
    plan: FlightPlan,
    parameters: Floats,
    results: KernelResults,
    recording: Recording,
    memory: Memory,
    *,
    start: SavedFlights | None = None,
    memory_in_rows: bool = False,
) -> None:
    """Simulate flights and fill ``results``. Raise ValueError if an array is invalid.

    If ``memory_in_rows`` is true, the memory of a custom control law is part of the lane memory.
    """
    if plan.lean and not np.array_equal(
        parameters[:, : _NOT_LEAN.size][:, _NOT_LEAN],
        nominal_parameters(len(parameters))[:, _NOT_LEAN],
    ):
        raise ValueError("the parameters disperse a quantity that a lean plan does not simulate")
    kernel_plan = make_kernel_plan(plan, parameters, recording, start)
    width = memory.Z.shape[1]
    in_rows = memory_in_rows or start is not None
    foreign = plan.vehicle.foreign
    settings = N_PARAMETERS + foreign.settings.size + foreign.states
    dispersed = kernel_plan.parameters.shape[1] > settings
    with open_law(plan, width, in_rows, len(parameters), dispersed) as user_code:
        choose_flight(width, plan.lean)(kernel_plan._replace(user_code=user_code), memory, results)
    fill_sampled(plan, results, complete=start is None)


def fill_sampled(plan: FlightPlan, results: KernelResults, complete: bool) -> None:
    """Compute the metrics of sampled values: quantiles, by linear interpolation, and robustness."""
    tick = plan.timing.tick
    unused = iter(results.samples)
    stops = results.end_tick + (results.outcome != Outcome.NOT_FINITE)
    for metric, values in zip(plan.metrics, results.metrics.T, strict=True):
        if metric.statistic == Statistic.QUANTILE:
            samples = next(unused)
            for flight in np.flatnonzero(np.isfinite(values)):
                counted = samples[flight][~np.isnan(samples[flight])]
                if counted.size:
                    values[flight] = np.quantile(counted, metric.limit) if complete else np.nan
        elif metric.statistic == Statistic.ROBUSTNESS:
            formula = compile_formula(metric.of, 1.0 / tick)
            signals = np.stack([next(unused) for _ in formula.sources])
            first = math.ceil((metric.start - 1e-9) / tick)
            after = (metric.end + 1e-9) / tick + 1.0
            for row, stop in enumerate(stops):
                window = signals[:, row, first : int(min(stop, after))].T
                values[row] = formula.find_robustness(window, metric.empty)


def join_bins(low: Floats, high: Floats, history: Singles) -> tuple[Singles, Singles]:
    """Return extremes [sample, channel] between the previous and the next sample.

    Extremes are NaN if there are no flights; -0 is replaced by 0. ``low`` and ``high`` are the
    extremes in the bins between samples, with low > high in an empty bin; ``history`` has the shape
    [flight, sample, channel].
    """
    has_value = low <= high
    return _join(np.where(has_value, low, np.nan), history, np.fmin), _join(
        np.where(has_value, high, np.nan), history, np.fmax
    )


def _join(bins: Floats, history: Singles, extreme: np.ufunc) -> Singles:
    following = bins.astype(np.float32)
    joined = following.copy()
    if len(history):
        joined[:-1] = extreme(following[:-1], extreme.reduce(history[:, 1:], axis=0))
    joined[1:] = extreme(joined[1:], following[:-1])
    return np.asarray(joined + np.float32(0.0), np.float32)
