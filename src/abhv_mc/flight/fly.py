"""The engine's one entrance: fly a plan under many dispersions."""

from functools import cache

import numpy as np

from abhv_mc.flight.lanes import LANES, LAWS, make_fly_lanes
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.flight.signals import CHANNELS, METRICS
from abhv_mc.plant.parameters import PARAMETERS
from abhv_mc.plant.state import N_STATES
from abhv_mc.vehicle.arrays import Floats

_lanes = cache(make_fly_lanes)


def nominal_parameters(flights: int = 1) -> Floats:
    """Undispersed parameters, ``[flight, parameter]``."""
    return np.tile([parameter.nominal for parameter in PARAMETERS], (flights, 1))


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
    parameters = np.ascontiguousarray(parameters, dtype=np.float64)
    if parameters.ndim != 2 or parameters.shape[1] != len(PARAMETERS):
        raise ValueError(f"parameters must be [flight, {len(PARAMETERS)}], not {parameters.shape}")
    timing = plan.timing
    every = record_every or 0
    samples = timing.ticks // every + 1 if every else 0
    flights = len(parameters)
    metrics = np.empty((flights, len(METRICS)))
    outcome = np.empty(flights, dtype=np.int64)
    end_tick = np.empty(flights, dtype=np.int64)
    history = np.full((flights, samples, len(CHANNELS)), np.nan, dtype=np.float32)
    states = np.full((flights, samples if keep_states else 0, N_STATES), np.nan)
    _lanes(lanes)(
        lanes,
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
        metrics,
        outcome,
        end_tick,
        history,
        states,
    )
    end_time = np.asarray(end_tick * timing.tick, dtype=np.float64)
    times = np.asarray(np.arange(samples) * every * timing.tick, dtype=np.float64)
    return FlightBlock(outcome, end_time, metrics, history, times, states)
