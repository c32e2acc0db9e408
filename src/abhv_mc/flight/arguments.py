"""What the compiled flight takes: plan, parameters and room for results, each array of the type and shape it trusts."""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.compile_metrics import Known, compile_metrics, known_sources
from abhv_mc.flight.outcome import LIMITS, Outcome
from abhv_mc.flight.plan import FlightPlan, Recording
from abhv_mc.flight.user_law import dispersable_settings
from abhv_mc.kernel.flight.counting import Statistic
from abhv_mc.kernel.flight.interface import (
    LQR,
    PYTHON,
    RECORDED,
    TLC,
    KernelPlan,
    KernelResults,
    Observed,
)
from abhv_mc.kernel.flight.memory import SAVED_ROWS
from abhv_mc.kernel.flight.observe import find_row
from abhv_mc.kernel.laws.columns import (
    LQR_GAINS,
    LQR_SETTINGS,
    RECORDED_GAINS,
    REFERENCE,
    TLC_GAINS,
    TLC_SETTINGS,
)
from abhv_mc.kernel.plant.air_data import PROFILE
from abhv_mc.kernel.plant.state import CUSTOM_STATE, N_PARAMETERS, N_STATES

LAWS = {"tlc": TLC, "lqr": LQR, "recorded": RECORDED, "python": PYTHON, "c": PYTHON, "fmu": PYTHON}
_COLUMNS = {  # of the gains and of the settings
    "tlc": (len(TLC_GAINS), len(TLC_SETTINGS)),
    "lqr": (len(LQR_GAINS), len(LQR_SETTINGS)),
    "recorded": (len(RECORDED_GAINS), None),
}  # a user law has any
_FLOWN = 0.5  # verdict of a flight that has met its mission's end: below every limit's code, and OK as a whole number


class Kept(NamedTuple):
    """Flights at a control tick, before its measurement: all that the kernel carries from tick to tick."""

    tick: int
    rows: Floats  # [flight, row] rows of the lane memory (abhv_mc.kernel.plant.state), then the observer's


def make_results(
    plan: FlightPlan, flights: int, recording: Recording, keep_states: bool, keep: bool = False
) -> KernelResults:
    """Room for the results; ``keep``: memories are kept."""
    samples, channels = recording.count_samples(plan.timing), len(recording.channels)
    bins = (samples if recording.extremes else 0, channels)
    return KernelResults(
        np.empty((flights, len(plan.metrics))),
        np.empty(flights, dtype=np.int64),
        np.empty(flights, dtype=np.int64),
        np.full((flights, samples, channels), np.nan, dtype=np.float32),
        np.full((flights, samples if keep_states else 0, N_STATES), np.nan),
        np.full(bins, np.inf),
        np.full(bins, -np.inf),
        np.zeros((flights, SAVED_ROWS if keep else 0)),
        np.full(
            (
                sum(metric.statistic == Statistic.QUANTILE for metric in plan.metrics),
                flights,
                plan.timing.ticks + 1,
            ),
            np.nan,
        ),
    )


def make_kernel_plan(
    plan: FlightPlan, parameters: Floats, recording: Recording, start: Kept | None = None
) -> KernelPlan:
    """A plan as the kernel takes it, see :func:`conform`. Raises ValueError for an array of the wrong type or shape."""
    terms = plan.vehicle.build_up.factor.size
    known = known_sources(plan.user_sources, plan.effectors, plan.custom_states)
    parameters = add_settings(plan, parameters)
    made = conform(
        KernelPlan(
            LAWS[plan.commanding_law],
            plan.vehicle,
            plan.trim_tables,
            plan.effectiveness,
            plan.earth,
            plan.timing,
            recording.every,
            make_observed(plan, [known[plan.channels[i].name] for i in recording.channels]),
            np.zeros(terms, np.int64),
            plan.initial_state,
            plan.reference,
            plan.gains,
            plan.settings,
            plan.profile,
            parameters,
            compile_metrics(plan.metrics, known),
            start.tick if start else 0,
            start.rows if start else np.empty((0, SAVED_ROWS)),
        ),
        KernelPlan,
        "plan",
    )
    gains, settings = _COLUMNS.get(plan.commanding_law, (None, None))
    foreign = plan.vehicle.foreign
    check_shape(made.initial_state, (N_STATES + foreign.states,), "plan.initial_state")
    columns = N_PARAMETERS + foreign.settings.size + foreign.states
    if made.parameters.ndim == 2 and made.parameters.shape[1] > columns:
        columns += len(dispersable_settings(plan))
    check_shape(made.parameters, (None, columns), "parameters")
    check_shape(made.start, (len(made.parameters) if start else 0, SAVED_ROWS), "start")
    check_shape(made.reference, (None, len(REFERENCE)), "plan.reference")
    check_shape(made.gains, (None, gains), "plan.gains")
    check_shape(made.settings, (settings,), "plan.settings")
    check_shape(made.profile, (None, len(PROFILE)), "plan.profile")
    rows = min(len(made.reference), len(made.gains))
    if rows <= plan.timing.ticks:
        raise ValueError(
            f"plan.reference or plan.gains has {rows} rows for control ticks 0 to {plan.timing.ticks}"
        )
    return made


def add_settings(plan: FlightPlan, parameters: Floats) -> Floats:
    """Rows [flight, parameter] with the vehicle file's settings, where they have none of their own.

    Of settings of laws, which follow those, the plan's own are left.
    """
    foreign = plan.vehicle.foreign
    nominal = np.concatenate([foreign.settings, np.zeros(foreign.states)])
    if parameters.ndim != 2 or parameters.shape[1] == N_PARAMETERS + nominal.size:
        return parameters
    if parameters.shape[1] == N_PARAMETERS:
        return np.hstack([parameters, np.tile(nominal, (len(parameters), 1))])
    known, first = plan.law_parameters.tolist(), N_PARAMETERS + nominal.size
    if parameters.shape[1] != first + len(known):
        return parameters
    own = [first + known.index(f"law.{name}") for name in dispersable_settings(plan)]
    return np.ascontiguousarray(parameters[:, [*range(first), *own]])


def make_observed(plan: FlightPlan, recorded: Sequence[Known]) -> Observed:
    """What a flight observes at each tick: its limits, and what it records."""
    limits = plan.limits
    bounded = [
        limit for limit in LIMITS if any(map(math.isfinite, limit.bounds(limits)))
    ]  # perhaps none
    bounds = np.array([limit.bounds(limits) for limit in bounded], np.float64).reshape(-1, 2)
    greatest = plan.vehicle.foreign.state_limit  # of custom states, which come first
    limited = np.flatnonzero(np.isfinite(greatest))
    own, number = greatest[limited], float(Outcome.STATE_LIMIT)
    return Observed(
        np.array(
            [*(CUSTOM_STATE + limited), *(find_row(limit.source) for limit in bounded)], np.int64
        ),
        np.array(
            [number] * own.size + [float(limit.outcome) or _FLOWN for limit in bounded], np.float64
        ),
        np.concatenate([-own, bounds[:, 0]]),
        np.concatenate([own, bounds[:, 1]]),
        np.array([channel.row for channel in recorded], np.int64),
        np.array([channel.factor for channel in recorded], np.float64),
    )


def conform(value: Any, kind: Any, name: str) -> Any:
    """A named tuple with every array C-contiguous, aligned and writable, for which alone numba has compiled.

    Raises ValueError for an array or number that is not of the type that the tuple's fields declare, however deep.
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
    expected = np.dtype(get_args(get_args(kind)[1])[0])
    if not isinstance(value, np.ndarray) or value.dtype != expected:
        found = (
            f"an array of {value.dtype}"
            if isinstance(value, np.ndarray)
            else f"a {type(value).__name__}"
        )
        raise ValueError(f"{name} is {found}, not an array of {expected}")
    return np.require(value, requirements=["C", "A", "O", "W"])


def check_shape(array: NDArray[Any], shape: tuple[int | None, ...], name: str) -> None:
    """Raise ValueError unless an array has a shape; None stands for any length."""
    if array.ndim != len(shape) or any(
        want not in (None, have) for have, want in zip(array.shape, shape, strict=True)
    ):
        words = ", ".join("any" if want is None else str(want) for want in shape)
        raise ValueError(f"{name} has the shape {array.shape}, not ({words})")


@cache
def _hints(kind: Any) -> dict[str, Any]:
    """The annotations of a named tuple's fields, in their order."""
    hints = get_type_hints(kind)
    return {field: hints[field] for field in kind._fields}
