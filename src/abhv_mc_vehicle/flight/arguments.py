"""Arguments of the simulation kernel, with checks of their types and shapes."""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flights.blocks import Recording
from abhv_mc.flights.expressions import SourceRow
from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.control.law_file import USER_LAWS
from abhv_mc_vehicle.flight.compile_metrics import compile_metrics, count_sampled, source_rows
from abhv_mc_vehicle.flight.plan import LIMITS, FlightPlan
from abhv_mc_vehicle.flight.plan_arrays import find_dtype
from abhv_mc_vehicle.flight.user_law import dispersable_settings
from abhv_mc_vehicle.kernel.flight.interface import (
    LQR,
    PYTHON,
    RECORDED,
    SAVED_ROWS,
    TLC,
    KernelPlan,
    KernelResults,
    Observed,
)
from abhv_mc_vehicle.kernel.flight.observe import find_row
from abhv_mc_vehicle.kernel.laws.columns import (
    LQR_GAINS,
    LQR_SETTINGS,
    RECORDED_GAINS,
    REFERENCE,
    TLC_GAINS,
    TLC_SETTINGS,
)
from abhv_mc_vehicle.kernel.plant.air_data import PROFILE
from abhv_mc_vehicle.kernel.plant.state import CUSTOM_STATE, N_PARAMETERS, N_STATES

LAWS = {"tlc": TLC, "lqr": LQR, "recorded": RECORDED} | dict.fromkeys(USER_LAWS, PYTHON)
COLUMNS = {  # numbers of gains and of settings, by control law
    "tlc": (len(TLC_GAINS), len(TLC_SETTINGS)),
    "lqr": (len(LQR_GAINS), len(LQR_SETTINGS)),
    "recorded": (len(RECORDED_GAINS), None),
}  # A custom control law may have any number of gains and settings.
# The kernel's outcome code for a flight that reached an end condition of its mission. Converted to
# an integer, the code is Outcome.OK.
_FLOWN = 0.5


class SavedFlights(NamedTuple):
    """Memory of flights at a control tick, before measurements are computed."""

    tick: int
    # [flight, row] lane memory (kernel.plant.state), followed by the observer's memory
    rows: Floats


def make_results(
    plan: FlightPlan,
    flights: int,
    recording: Recording,
    keep_states: bool,
    save_memory: bool = False,
) -> KernelResults:
    """Return result arrays for the kernel to fill.

    If ``save_memory`` is true, the kernel also saves the memory of each flight.
    """
    samples = recording.count_samples(plan.timing)
    channels = len(recording.channels)
    bins = (samples if recording.extremes else 0, channels)
    return KernelResults(
        metrics=np.empty((flights, len(plan.metrics))),
        outcome=np.empty(flights, np.int64),
        end_tick=np.empty(flights, np.int64),
        history=np.full((flights, samples, channels), np.nan, np.float32),
        states=np.full((flights, samples if keep_states else 0, N_STATES), np.nan),
        low=np.full(bins, np.inf),
        high=np.full(bins, -np.inf),
        saved=np.zeros((flights, SAVED_ROWS if save_memory else 0)),
        samples=np.full(
            (
                count_sampled(plan.metrics),
                flights,
                plan.timing.ticks + 1,
            ),
            np.nan,
        ),
    )


def make_kernel_plan(
    plan: FlightPlan, parameters: Floats, recording: Recording, start: SavedFlights | None = None
) -> KernelPlan:
    """Return a plan in the form that the kernel requires.

    Raise ValueError if an array has a wrong type or shape.
    """
    terms = plan.vehicle.build_up.factor.size
    sources = source_rows(plan.user_sources, plan.effectors, plan.custom_states)
    channels = plan.channels
    parameters = add_settings(plan, parameters)
    kernel_plan = conform(
        KernelPlan(
            law=LAWS[plan.commanding_law],
            vehicle=plan.vehicle,
            trim_tables=plan.trim_tables,
            effectiveness=plan.effectiveness,
            earth=plan.earth,
            timing=plan.timing,
            record_every=recording.every,
            observed=make_observed(plan, [sources[channels[i].name] for i in recording.channels]),
            unit_factors=np.zeros(terms, np.int64),
            initial_state=plan.initial_state,
            reference=plan.reference,
            gains=plan.gains,
            settings=plan.settings,
            profile=plan.profile,
            parameters=parameters,
            counted=compile_metrics(plan.metrics, sources),
            first_tick=start.tick if start else 0,
            start=start.rows if start else np.empty((0, SAVED_ROWS)),
        ),
        KernelPlan,
        "plan",
    )
    gains, settings = COLUMNS.get(plan.commanding_law, (None, None))
    foreign = plan.vehicle.foreign
    check_shape(kernel_plan.initial_state, (N_STATES + foreign.states,), "plan.initial_state")
    columns = N_PARAMETERS + foreign.settings.size + foreign.states
    if kernel_plan.parameters.ndim == 2 and kernel_plan.parameters.shape[1] > columns:
        columns += len(dispersable_settings(plan))
    check_shape(kernel_plan.parameters, (None, columns), "parameters")
    check_shape(
        kernel_plan.start, (len(kernel_plan.parameters) if start else 0, SAVED_ROWS), "start"
    )
    check_shape(kernel_plan.reference, (None, len(REFERENCE)), "plan.reference")
    check_shape(kernel_plan.gains, (None, gains), "plan.gains")
    check_shape(kernel_plan.settings, (settings,), "plan.settings")
    check_shape(kernel_plan.profile, (None, len(PROFILE)), "plan.profile")
    rows = min(len(kernel_plan.reference), len(kernel_plan.gains))
    if rows <= plan.timing.ticks:
        raise ValueError(
            f"plan.reference or plan.gains has only {rows} rows for control ticks 0 to "
            f"{plan.timing.ticks}"
        )
    return kernel_plan


def add_settings(plan: FlightPlan, parameters: Floats) -> Floats:
    """Return rows [flight, parameter], with settings and initial custom states appended.

    Rows that already have these values are unchanged, except that settings of other control laws
    are removed from the end of the rows.
    """
    foreign = plan.vehicle.foreign
    nominal = np.concatenate([foreign.settings, np.zeros(foreign.states)])
    if parameters.ndim != 2 or parameters.shape[1] == N_PARAMETERS + nominal.size:
        return parameters
    if parameters.shape[1] == N_PARAMETERS:
        return np.hstack([parameters, np.tile(nominal, (len(parameters), 1))])
    law_parameters = plan.law_parameters.tolist()
    first = N_PARAMETERS + nominal.size
    if parameters.shape[1] != first + len(law_parameters):
        return parameters
    law_columns = [
        first + law_parameters.index(f"law.{name}") for name in dispersable_settings(plan)
    ]
    return np.ascontiguousarray(parameters[:, [*range(first), *law_columns]])


def make_observed(plan: FlightPlan, recorded: Sequence[SourceRow]) -> Observed:
    """Return the limits and recorded channels that the kernel evaluates at each tick."""
    limits = plan.limits
    bounded = [
        limit for limit in LIMITS if any(map(math.isfinite, limit.bounds(limits)))
    ]  # The list is empty if no limit is finite.
    bounds = np.array([limit.bounds(limits) for limit in bounded], np.float64).reshape(-1, 2)
    state_limits = plan.vehicle.foreign.state_limit  # Limits of custom states come first.
    limited = np.flatnonzero(np.isfinite(state_limits))
    state_bounds = state_limits[limited]
    state_outcome = float(Outcome.STATE_LIMIT)
    return Observed(
        np.array(
            [*(CUSTOM_STATE + limited), *(find_row(limit.source) for limit in bounded)], np.int64
        ),
        np.array(
            [state_outcome] * state_bounds.size
            + [float(limit.outcome) or _FLOWN for limit in bounded],
            np.float64,
        ),
        np.concatenate([-state_bounds, bounds[:, 0]]),
        np.concatenate([state_bounds, bounds[:, 1]]),
        np.array([channel.row for channel in recorded], np.int64),
        np.array([channel.factor for channel in recorded], np.float64),
    )


def conform(value: Any, kind: Any, name: str) -> Any:
    """Return a named tuple whose arrays have the layout that compiled code expects.

    Arrays are C-contiguous, aligned and writable. Raise ValueError if an array or number does not
    have the declared type; nested tuples are checked as well.
    """
    if hasattr(kind, "_fields"):
        members = zip(_hints(kind).items(), value, strict=True)
        return kind(
            *(conform(member, hint, f"{name}.{field}") for (field, hint), member in members)
        )
    if kind in (int, float):
        if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
            raise ValueError(f"{name} is {value!r:.60}, not a number")
        return kind(value)
    expected = find_dtype(kind)
    if not isinstance(value, np.ndarray) or value.dtype != expected:
        actual = (
            f"an array of {value.dtype}"
            if isinstance(value, np.ndarray)
            else f"a {type(value).__name__}"
        )
        raise ValueError(f"{name} is {actual}, not an array of {expected}")
    return np.require(value, requirements=["C", "A", "O", "W"])


def check_shape(array: NDArray[Any], shape: tuple[int | None, ...], name: str) -> None:
    """Raise ValueError unless an array has the expected shape; None allows any length."""
    if array.ndim != len(shape) or any(
        expected_length not in (None, length)
        for length, expected_length in zip(array.shape, shape, strict=True)
    ):
        expected = ", ".join(
            "any" if expected_length is None else str(expected_length) for expected_length in shape
        )
        raise ValueError(f"{name} has the shape {array.shape}, not ({expected})")


@cache
def _hints(kind: Any) -> dict[str, Any]:
    """Return the annotations of a named tuple's fields, in order."""
    hints = get_type_hints(kind)
    return {field: hints[field] for field in kind._fields}
