"""The engine's one entrance: fly a plan under many dispersions."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.flight.lanes import LAWS, make_fly_lanes
from abhv_mc.flight.memory import make_memory
from abhv_mc.flight.plan import LANES, FlightBlock, FlightPlan
from abhv_mc.flight.signals import CHANNELS, METRICS
from abhv_mc.plant.parameters import PARAMETERS
from abhv_mc.plant.state import N_STATES
from abhv_mc.vehicle.arrays import Floats

compiled_flight: Callable[[int], Any] = cache(make_fly_lanes)


def nominal_parameters(flights: int = 1) -> Floats:
    """Undispersed parameters, ``[flight, parameter]``."""
    return np.tile([parameter.nominal for parameter in PARAMETERS], (flights, 1))


class Results(NamedTuple):
    """What the compiled flight fills, in the order of its arguments."""

    metrics: Floats  # [flight, metric]
    outcome: NDArray[np.int64]  # [flight]
    end_tick: NDArray[np.int64]  # [flight]
    history: NDArray[np.float32]  # [flight, sample, channel]
    states: Floats  # [flight, sample, state]; no samples where not asked for


def check_parameters(parameters: Floats) -> Floats:
    """Parameters as the compiled flight wants them. Raises ValueError for an array of the wrong shape."""
    parameters = np.ascontiguousarray(parameters, dtype=np.float64)
    if parameters.ndim != 2 or parameters.shape[1] != len(PARAMETERS):
        raise ValueError(f"parameters must be [flight, {len(PARAMETERS)}], not {parameters.shape}")
    return parameters


def make_results(plan: FlightPlan, flights: int, every: int, keep_states: bool) -> Results:
    """Room for the results; ``every`` counts ticks between samples, 0 for none."""
    samples = plan.timing.ticks // every + 1 if every else 0
    return Results(
        np.empty((flights, len(METRICS))),
        np.empty(flights, dtype=np.int64),
        np.empty(flights, dtype=np.int64),
        np.full((flights, samples, len(CHANNELS)), np.nan, dtype=np.float32),
        np.full((flights, samples if keep_states else 0, N_STATES), np.nan),
    )


def make_block(plan: FlightPlan, results: Results, every: int) -> FlightBlock:
    """Filled results as what the engine returns."""
    tick = plan.timing.tick
    end_time = np.asarray(results.end_tick * tick, dtype=np.float64)
    times = np.asarray(np.arange(results.history.shape[1]) * every * tick, dtype=np.float64)
    return FlightBlock(results.outcome, end_time, results.metrics, results.history, times, results.states)


def fly(
    plan: FlightPlan,
    parameters: Floats,
    record_every: int | None = None,
    lanes: int = LANES,
    keep_states: bool = False,
) -> FlightBlock:
    """Fly every row of ``parameters`` [flight, parameter] (order of PARAMETERS).

    ``record_every`` counts control ticks between the recorded samples (None: no history); ``keep_states`` adds the
    whole state in double precision to them. A flight depends on its row and the plan alone: not on the other rows,
    nor on how many fly abreast (``lanes``). Releases the interpreter's lock, so threads may call it side by side.
    Raises ValueError for an array of the wrong shape.
    """
    parameters = check_parameters(parameters)
    every = record_every or 0
    results = make_results(plan, len(parameters), every, keep_states)
    compiled_flight(lanes)(*flight_arguments(plan, parameters, results, every, lanes))
    return make_block(plan, results, every)


def flight_arguments(plan: FlightPlan, parameters: Floats, results: Results, every: int, lanes: int) -> tuple[Any, ...]:
    """What the compiled flight takes."""
    timing = plan.timing
    return (
        plan.vehicle,
        plan.trim_tables,
        plan.effectiveness,
        plan.earth,
        LAWS[plan.law],
        plan.reference,
        plan.gains,
        plan.settings,
        plan.limits,
        timing.step,
        timing.steps_per_tick,
        timing.ticks,
        every,
        parameters,
        plan.initial_state,
        *results,
        make_memory(lanes, plan.vehicle.build_up.factor.size),
    )
