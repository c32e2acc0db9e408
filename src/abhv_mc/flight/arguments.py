"""What the compiled flight takes: three named tuples, checked where Python hands them over.

Compiled code trusts its arrays: of the right type and shape, C-contiguous and aligned, and none that is written to
shares memory with another. That is checked here, once a call.
"""

from bisect import bisect_left
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.compile_metrics import compile_metrics, known_sources
from abhv_mc.flight.observed import make_observed
from abhv_mc.flight.plan import FlightPlan, Recording
from abhv_mc.kernel.flight.counting import Statistic
from abhv_mc.kernel.flight.interface import LQR, PYTHON, RECORDED, TLC, KernelPlan, KernelResults
from abhv_mc.kernel.flight.memory import SAVED_ROWS, Memory
from abhv_mc.kernel.laws.columns import LQR_GAINS, LQR_SETTINGS, REFERENCE, TLC_GAINS, TLC_SETTINGS
from abhv_mc.kernel.laws.recorded import RECORDED_GAINS
from abhv_mc.kernel.plant.air_profile import PROFILE
from abhv_mc.kernel.plant.state import N_PARAMETERS, N_STATES

LAWS = {"tlc": TLC, "lqr": LQR, "recorded": RECORDED, "python": PYTHON, "c": PYTHON, "fmu": PYTHON}
_COLUMNS = {  # of the gains and of the settings
    "tlc": (len(TLC_GAINS), len(TLC_SETTINGS)),
    "lqr": (len(LQR_GAINS), len(LQR_SETTINGS)),
    "recorded": (len(RECORDED_GAINS), None),
    "python": (None, None),
    "c": (None, None),
    "fmu": (None, None),
}


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
            (sum(metric.statistic == Statistic.QUANTILE for metric in plan.metrics), flights, plan.timing.ticks + 1),
            np.nan,
        ),
    )


def make_kernel_plan(
    plan: FlightPlan, parameters: Floats, recording: Recording, start: Kept | None = None
) -> KernelPlan:
    """A plan as the kernel takes it, its arrays copied where they are not contiguous, aligned and writable.

    Raises ValueError for an array of the wrong type or shape.
    """
    terms = plan.vehicle.build_up.factor.size
    made = conform(
        KernelPlan(
            LAWS[plan.law],
            plan.vehicle,
            plan.trim_tables,
            plan.effectiveness,
            plan.earth,
            plan.timing,
            recording.every,
            make_observed(plan.limits, tuple(plan.channels[i] for i in recording.channels)),
            np.zeros(terms, np.int64),
            plan.initial_state,
            plan.reference,
            plan.gains,
            plan.settings,
            plan.profile,
            parameters,
            compile_metrics(plan.metrics, known_sources(plan.user_sources, plan.effectors)),
            start.tick if start else 0,
            start.rows if start else np.empty((0, SAVED_ROWS)),
        ),
        KernelPlan,
        "plan",
    )
    columns, settings = _COLUMNS[plan.law]
    check_shape(made.initial_state, (N_STATES,), "plan.initial_state")
    check_shape(made.parameters, (None, N_PARAMETERS), "parameters")
    check_shape(made.start, (len(made.parameters) if start else 0, SAVED_ROWS), "start")
    check_shape(made.reference, (None, len(REFERENCE)), "plan.reference")
    check_shape(made.gains, (None, columns), "plan.gains")
    check_shape(made.settings, (settings,), "plan.settings")
    check_shape(made.profile, (None, len(PROFILE)), "plan.profile")
    rows = min(len(made.reference), len(made.gains))
    if rows <= plan.timing.ticks:
        raise ValueError(f"plan.reference or plan.gains has {rows} rows for control ticks 0 to {plan.timing.ticks}")
    return made


def conform(value: Any, kind: Any, name: str) -> Any:
    """A named tuple of a type, however deep, with every array C-contiguous, aligned and writable: copied where not.

    Writable, because numba would compile once more for arrays that are not. Raises ValueError for an array or number
    that is not of the type that the tuple's fields declare.
    """
    if hasattr(kind, "_fields"):
        members = zip(_hints(kind).items(), value, strict=True)
        return kind(*(conform(member, hint, f"{name}.{field}") for (field, hint), member in members))
    if kind in (int, float):
        if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
            raise ValueError(f"{name} is {value!r:.60}, not a number")
        return kind(value)
    check_type(value, kind, name)
    return np.require(value, requirements=["C", "A", "O", "W"])


def check_type(array: Any, kind: Any, name: str) -> None:
    """Raise ValueError unless an array has the type that an annotation such as ``Floats`` declares."""
    expected = np.dtype(get_args(get_args(kind)[1])[0])
    if not isinstance(array, np.ndarray) or array.dtype != expected:
        found = f"an array of {array.dtype}" if isinstance(array, np.ndarray) else f"a {type(array).__name__}"
        raise ValueError(f"{name} is {found}, not an array of {expected}")


def check_shape(array: NDArray[Any], shape: tuple[int | None, ...], name: str) -> None:
    """Raise ValueError unless an array has a shape; None stands for any length."""
    if array.ndim != len(shape) or any(want not in (None, have) for have, want in zip(array.shape, shape, strict=True)):
        words = ", ".join("any" if want is None else str(want) for want in shape)
        raise ValueError(f"{name} has the shape {array.shape}, not ({words})")


def check_written(plan: KernelPlan, memory: Memory, results: KernelResults) -> None:
    """Refuse arrays that the kernel cannot write to, or that share memory with another one of its arguments.

    Raises ValueError.
    """
    flights = len(plan.parameters)
    metrics = plan.counted.lean.place.size + plan.counted.programs.place.size
    check_shape(results.metrics, (flights, metrics), "results.metrics")
    check_shape(results.outcome, (flights,), "results.outcome")
    check_shape(results.end_tick, (flights,), "results.end_tick")
    samples = plan.timing.ticks // plan.record_every + 1 if plan.record_every else 0
    channels = plan.observed.channel_row.size
    check_shape(results.history, (flights, samples, channels), "results.history")
    check_shape(results.states, (flights, samples if results.states.size else 0, N_STATES), "results.states")
    check_shape(results.low, (samples if results.low.size else 0, channels), "results.low")
    check_shape(results.high, results.low.shape, "results.high")
    check_shape(results.samples, (None, flights, plan.timing.ticks + 1), "results.samples")
    check_shape(results.kept, (flights, SAVED_ROWS if results.kept.size else 0), "results.kept")
    written = []
    for value, of in ((memory, "memory"), (results, "results")):
        for name, array, kind in _arrays(value, of):
            check_type(array, kind, name)
            if not (array.flags.c_contiguous and array.flags.aligned and array.flags.writeable):
                raise ValueError(f"{name} is not an aligned, C-contiguous and writable array")
            if array.size:
                written.append((*np.lib.array_utils.byte_bounds(array), name))
    written.sort()
    for (_, end, name), (start, _, other) in pairwise(written):
        if start < end:
            raise ValueError(f"{name} and {other} share memory and both are written to")
    starts = [start for start, _, _ in written]
    for name, array, _ in _arrays(plan, "plan"):
        start, end = np.lib.array_utils.byte_bounds(array)
        below = bisect_left(starts, end) - 1  # the last written array that begins before this one ends
        if array.size and below >= 0 and written[below][1] > start:
            raise ValueError(f"{name} shares memory with {written[below][2]}, which is written to")


def _arrays(value: Any, name: str) -> Iterator[tuple[str, NDArray[Any], Any]]:
    """The arrays of a named tuple, however deep, with their names and annotations."""
    kind: Any = type(value)
    for (field, hint), member in zip(_hints(kind).items(), value, strict=True):
        if hasattr(hint, "_fields"):
            yield from _arrays(member, f"{name}.{field}")
        elif hint not in (int, float):
            yield f"{name}.{field}", member, hint


@cache
def _hints(kind: Any) -> dict[str, Any]:
    """The annotations of a named tuple's fields, in their order."""
    hints = get_type_hints(kind)
    return {field: hints[field] for field in kind._fields}
