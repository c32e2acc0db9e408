"""Whether a stored plan may be flown: compiled code follows its index arrays without a look at their bounds."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from abhv_mc.control.columns import LQR_GAINS, LQR_SETTINGS, REFERENCE, TLC_GAINS, TLC_SETTINGS
from abhv_mc.control.laws.trim_lookup import AXES as TRIM_AXES
from abhv_mc.flight.compile_metrics import compile_metrics, known_sources
from abhv_mc.flight.plan import FlightPlan, Timing
from abhv_mc.io.input_error import is_printable
from abhv_mc.plant.air_profile import PROFILE
from abhv_mc.plant.effectiveness import Effectiveness, count_rows, make_effectiveness
from abhv_mc.plant.parameters import PARAMETERS
from abhv_mc.plant.state import MAX_AXES, MAX_TABLE_ROWS, N_STATES
from abhv_mc.vehicle.arrays import CHUNK, COEFFICIENTS, FIXED_TABLE_ROWS, MAX_DIMENSIONS, VARIABLES, BuildUp, Tables

_COLUMNS = {"tlc": (len(TLC_GAINS), len(TLC_SETTINGS)), "lqr": (len(LQR_GAINS), len(LQR_SETTINGS))}
_MAX_TICKS, _MAX_STEPS, _MAX_STEP = 10_000_000, 100_000, 10.0


def find_fault(plan: FlightPlan) -> str | None:
    """What of a plan, whose parts have their types, does not fit together; None where all does."""
    return next(_faults(plan), None)


def _faults(plan: FlightPlan) -> Iterator[str]:
    tables, build_up = plan.vehicle.tables, plan.vehicle.build_up
    yield from _timing_faults(plan.timing)
    yield from _table_faults(tables, "vehicle.tables")
    yield from _table_faults(plan.trim_tables, "trim_tables")
    yield from _trim_faults(plan.trim_tables)
    yield from _term_faults(build_up, tables)
    yield from _shape_faults({"vehicle.effector_mix": (plan.vehicle.effector_mix, (4, 3))})
    if count_rows(plan.vehicle) > MAX_TABLE_ROWS:
        yield f"vehicle: more than {MAX_TABLE_ROWS} rows of tables"
    yield from _effectiveness_faults(plan.effectiveness, make_effectiveness(plan.vehicle))
    yield from _declared_faults(plan)
    own = (plan.gain_names.size, plan.settings.size)  # a law of one's own says how many
    if plan.law not in (*_COLUMNS, "python"):
        yield f"law '{plan.law}'"
        return
    gains, settings = _COLUMNS.get(plan.law, own)
    ticks = plan.timing.ticks + 1
    yield from _shape_faults(
        {
            "initial_state": (plan.initial_state, (N_STATES,)),
            "reference": (plan.reference, (ticks, len(REFERENCE))),
            "gains": (plan.gains, (ticks, gains)),
            "settings": (plan.settings, (settings,)),
            "profile": (plan.profile, (len(plan.profile), len(PROFILE))),
        }
    )
    for name in ("warnings", "gain_names"):
        if getattr(plan, name).ndim != 1:
            yield f"{name}: no list"
    shown = (plan.controller, *plan.warnings.flat, *plan.gain_names.flat, *plan.declared.flat)
    if not all(is_printable(str(text)) for text in shown):
        yield "names or warnings with characters that nothing shows"


def _timing_faults(timing: Timing) -> Iterator[str]:
    if not (0.0 < timing.step <= _MAX_STEP and 1 <= timing.steps_per_tick <= _MAX_STEPS):
        yield f"timing: {timing.steps_per_tick} steps of {timing.step} s"
    if not 1 <= timing.ticks <= _MAX_TICKS:
        yield f"timing: {timing.ticks} ticks"


def _table_faults(t: Tables, name: str) -> Iterator[str]:
    axes, groups, nodes = t.axis_variable.size, t.group_start.size, t.grid.size
    if not (1 <= axes <= MAX_AXES and groups >= 1 and 1 <= t.n_rows <= MAX_TABLE_ROWS):
        yield f"{name}: {axes} axes, {groups} groups, {t.n_rows} rows"
        return
    shapes: dict[str, tuple[Any, tuple[int, ...]]] = {
        f"{name}.{field}": (getattr(t, field), (axes,)) for field in ("axis_variable", "axis_start", "axis_length")
    }
    shapes |= {f"{name}.{field}": (getattr(t, field), (nodes,)) for field in ("grid", "inverse_step")}
    plain = ("group_dimensions", "group_start", "group_width", "group_used", "group_row")
    shapes |= {f"{name}.{field}": (getattr(t, field), (groups,)) for field in plain}
    deep = ("group_axis", "group_stride")
    shapes |= {f"{name}.{field}": (getattr(t, field), (groups, MAX_DIMENSIONS)) for field in deep}
    shapes[f"{name}.data"] = (t.data, (t.data.size,))
    shapes[f"{name}.fixed_row"] = (t.fixed_row, (len(FIXED_TABLE_ROWS),))
    wrong = list(_shape_faults(shapes))
    yield from wrong
    if wrong:
        return
    size = t.data.size
    yield from _range_faults(
        {
            f"{name}.axis_variable": (t.axis_variable, 0, len(VARIABLES) - 1),
            f"{name}.axis_start": (t.axis_start, 0, nodes - 1),
            f"{name}.axis_length": (t.axis_length, 2, nodes),
            f"{name}.group_dimensions": (t.group_dimensions, 2, MAX_DIMENSIONS),
            f"{name}.group_axis": (t.group_axis, 0, axes - 1),
            f"{name}.group_stride": (t.group_stride, 0, size),
            f"{name}.group_start": (t.group_start, 0, size - 1),
            f"{name}.group_width": (t.group_width, CHUNK, t.n_rows),
            f"{name}.group_used": (t.group_used, 1, t.n_rows),
            f"{name}.group_row": (t.group_row, 0, t.n_rows - 1),
            f"{name}.fixed_row": (t.fixed_row, 0, t.n_rows - 1),
        }
    )
    if (t.axis_start + t.axis_length > nodes).any():
        yield f"{name}: an axis beyond the grid"
        return
    if (t.group_width % CHUNK).any() or (t.group_used > t.group_width).any():
        yield f"{name}.group_width: not made of {CHUNK}s, or less than is used"
    if (t.group_row + t.group_width > t.n_rows).any():
        yield f"{name}: a group beyond the rows"
    last = (t.group_stride * (t.axis_length[t.group_axis] - 1)).sum(axis=1)
    if (t.group_start + last + t.group_width > size).any():
        yield f"{name}: a group beyond the data"
    for start, length in zip(t.axis_start.tolist(), t.axis_length.tolist(), strict=True):
        steps = np.diff(t.grid[start : start + length])
        if not (steps > 0.0).all() or not np.array_equal(t.inverse_step[start : start + length - 1], 1.0 / steps):
            yield f"{name}.grid: an axis that does not rise, or whose steps are others"
            return


def _trim_faults(t: Tables) -> Iterator[str]:
    """The look-up of the trim tables reads one group on three axes."""
    if t.axis_variable.size < TRIM_AXES or t.group_dimensions[0] != TRIM_AXES or t.group_width[0] != CHUNK:
        yield "trim_tables: other tables than those of the trim"
    elif not np.array_equal(t.group_axis[0], np.arange(TRIM_AXES)):
        yield "trim_tables.group_axis: other axes than those of the trim"


def _term_faults(terms: BuildUp, tables: Tables) -> Iterator[str]:
    count = terms.coefficient.size
    wrong = list(_shape_faults({f"vehicle.build_up.{k}": (v, (count,)) for k, v in terms._asdict().items()}))
    yield from wrong
    if not wrong:
        limits = {
            "coefficient": len(COEFFICIENTS),
            "table": tables.n_rows,
            "variable": len(VARIABLES),
            "factor": len(PARAMETERS),
        }
        yield from _range_faults(
            {f"vehicle.build_up.{name}": (getattr(terms, name), 0, limit - 1) for name, limit in limits.items()}
        )


def _declared_faults(plan: FlightPlan) -> Iterator[str]:
    """What a campaign declares is text, which is compiled anew."""
    if plan.own_sources.ndim != 2 or plan.own_sources.shape[1] != 2:
        yield f"own_sources: shape {plan.own_sources.shape}"
        return
    try:
        compile_metrics(plan.metrics, known_sources(plan.own_sources))
    except (ValueError, KeyError) as error:
        yield f"declared: {error}"


def _effectiveness_faults(held: Effectiveness, made: Effectiveness) -> Iterator[str]:
    """It follows from the vehicle to the bit."""
    for name, value in made._asdict().items():
        if not np.array_equal(getattr(held, name), value):
            yield f"effectiveness.{name}: not that of the vehicle"


def _shape_faults(parts: dict[str, tuple[Any, tuple[int, ...]]]) -> Iterator[str]:
    for name, (array, shape) in parts.items():
        if array.shape != shape:
            yield f"{name}: shape {array.shape} instead of {shape}"


def _range_faults(parts: dict[str, tuple[Any, int, int]]) -> Iterator[str]:
    for name, (array, low, high) in parts.items():
        if array.size and not (low <= array.min() and array.max() <= high):
            yield f"{name}: values from {array.min()} to {array.max()}, where {low} to {high} may be"
