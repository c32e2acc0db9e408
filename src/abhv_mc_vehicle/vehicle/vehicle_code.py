"""Custom functions of a vehicle, and evaluation of tables and functions with numpy.

Coefficients are built up outside compiled code.

The module :mod:`abhv_mc_vehicle.user_code.vehicle_functions` compiles the functions, and registers
an evaluator in this module under the digest of the code.

The functions ``evaluate_tables`` and ``table_rows`` sum over the corners of a cell in different
orders. Both are needed to reproduce the last digits of results: trims depend on the order in
``evaluate_tables``, and controller designs depend on the order in ``table_rows``.
"""

import functools
import hashlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from abhv_mc.array_types import Floats, Numbers
from abhv_mc.io.messages import InputError
from abhv_mc.io.units import parse_any, si_unit_of, unit_of
from abhv_mc_vehicle.kernel.plant.vehicle import (
    AXES,
    COEFFICIENTS,
    FIXED_TABLE_ROWS,
    VARIABLES,
    Foreign,
    Tables,
    Vehicle,
)
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere

N_THRUST = 7  # number of values of a propulsion function: force, moment, fuel flow
STEP = 1e-5  # step of the central differences, rad
_ALTITUDE = VARIABLES.index("altitude")
_MACH = VARIABLES.index("mach")


@dataclass(frozen=True)
class FunctionCode:
    """Custom function: source file, function name, and settings from the vehicle file."""

    text: str
    file: str
    function: str
    settings: tuple[tuple[str, Any], ...]


class Setting(NamedTuple):
    """Setting of a custom function, which a campaign may disperse."""

    name: str  # name such as dynamics.frequency
    unit: str  # SI unit of the value
    value: float


class CustomState(NamedTuple):
    """State variable of custom dynamics."""

    name: str
    unit: str
    # initial value in SI; None if the state starts in equilibrium at the trim point
    start: float | None
    limit: float = math.inf  # maximum magnitude of the state


@dataclass(frozen=True)
class VehicleCode:
    """Custom code of a vehicle, which is sent to workers with a plan but not stored with it."""

    aerodynamics: FunctionCode | None
    propulsion: FunctionCode | None
    dynamics: FunctionCode | None
    states: tuple[CustomState, ...]
    frame: str  # axes of the aerodynamic forces: body, stability or wind
    # x and z (m) of the moment reference, relative to the point about which the engine function
    # returns its moments
    engine: tuple[float, float]
    # (name, deflections per unit of aileron, rudder and elevator)
    effectors: tuple[tuple[str, float, float, float], ...]
    span: float
    chord: float
    circular: frozenset[str] = frozenset()  # names of circular states

    def functions(self) -> Iterator[FunctionCode]:
        """Yield the custom functions that are defined."""
        yield from (function for _, function in self.named_functions() if function is not None)

    def named_functions(self) -> tuple[tuple[str, FunctionCode | None], ...]:
        """Return each section of the vehicle file with its custom function or None."""
        return (
            ("aerodynamics", self.aerodynamics),
            ("propulsion", self.propulsion),
            ("dynamics", self.dynamics),
        )

    @functools.cached_property
    def settings(self) -> tuple[Setting, ...]:
        """Values of the settings, in the order of ``Foreign.settings``.

        Raise Refusal if a value is invalid.
        """
        return tuple(
            Setting(f"{key}.{name}", si_unit_of(unit_of(value)), parse_any(value))
            for key, function in self.named_functions()
            for name, value in (function.settings if function else ())
        )

    @functools.cached_property
    def starts(self) -> tuple[Setting, ...]:
        """Dispersions of the initial states, which follow the settings in parameter arrays."""
        return tuple(Setting(f"initial.{state.name}", state.unit, 0.0) for state in self.states)

    @property
    def digest(self) -> bytes:
        """SHA-256 digest of the sources and calling conventions, but not of file paths."""
        parts = [
            (code.text, code.function, code.settings) if code else None
            for _, code in self.named_functions()
        ]
        conventions = self.frame, self.engine, self.effectors, self.span, self.chord, self.states
        return hashlib.sha256(repr((parts, *conventions)).encode()).digest()

    def pack(self) -> Foreign:
        """Return the custom code in the form that the compiled plant uses."""
        return Foreign(
            int(self.aerodynamics is not None),
            int(self.propulsion is not None),
            *self.engine,
            np.frombuffer(self.digest, np.int64).copy(),
            np.array([setting.value for setting in self.settings], np.float64),
            len(self.states),
            np.array([state.limit for state in self.states], np.float64),
        )


def name_states(code: VehicleCode | None) -> tuple[tuple[str, str, bool], ...]:
    """Return the names and units of custom states, and whether each state is circular."""
    if code is None:
        return ()
    return tuple((state.name, state.unit, state.name in code.circular) for state in code.states)


Evaluator = Callable[[Floats, Floats, Floats], tuple[Floats, Floats]]
_evaluators: dict[bytes, Evaluator] = {}


def register(digest: bytes, evaluate: Evaluator) -> None:
    """Register the evaluator of vehicle functions with the given digest."""
    _evaluators[digest] = evaluate


def evaluate_functions(
    vehicle: Vehicle, variables: Any, density: Any = None, speed: Any = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return stability-axis coefficients [coefficient, point] and thrust [7, point].

    The imaginary part of a complex argument is a direction, along which derivatives are computed by
    central differences. Density (kg/m3) and speed (m/s) default to those of the standard atmosphere
    at the altitude and Mach number of the variables.
    """
    digest = vehicle.foreign.digest.tobytes()
    if digest not in _evaluators:
        raise InputError(
            "vehicle",
            "the functions were not loaded",
            "a vehicle read by load_vehicle, which loads the functions",
        )
    shape = variables.shape[1:]
    points = variables.reshape(len(variables), -1)
    if density is None or speed is None:
        air = [atmosphere(float(altitude)) for altitude in np.real(points[_ALTITUDE])]
        density = np.reshape([layer[0] for layer in air], shape)
        speed = variables[_MACH] * np.reshape([layer[3] for layer in air], shape)
    arguments = [points, *(np.broadcast_to(value, shape).reshape(-1) for value in (density, speed))]
    evaluate = _evaluators[digest]
    real = [np.ascontiguousarray(np.real(value), np.float64) for value in arguments]
    if not any(np.iscomplexobj(value) for value in arguments):
        results = evaluate(*real)
        return results[0].reshape(-1, *shape), results[1].reshape(-1, *shape)
    directions = [np.imag(value) for value in arguments]
    size = np.maximum.reduce(
        [np.abs(directions[0]).max(axis=0), np.abs(directions[1]), np.abs(directions[2])]
    )
    unit = [value / np.where(size > 0.0, size, 1.0) for value in directions]
    middle = evaluate(*real)
    ends = [
        evaluate(*(value + step * direction for value, direction in zip(real, unit, strict=True)))
        for step in (STEP, -STEP)
    ]
    complex_results = [
        (value + 1j * size * (above - below) / (2.0 * STEP)).reshape(-1, *shape)
        for value, above, below in zip(middle, *ends, strict=True)
    ]
    return complex_results[0], complex_results[1]


_AXIS_DEFLECTIONS = [VARIABLES.index(name) for name in AXES]
_FIRST_EFFECTOR = VARIABLES.index("effector_0")


def make_variables(vehicle: Vehicle, **values: ArrayLike) -> Numbers:
    """Return variables [variable, point] from named values (SI, radians).

    Variables without a value are zero; effector deflections follow from the axis deflections.
    """
    arrays = [np.asarray(value) for value in values.values()]
    shape = np.broadcast_shapes((1,), *(array.shape for array in arrays))
    variables = np.zeros((len(VARIABLES), *shape), np.result_type(np.float64, *arrays))
    variables[0] = 1.0
    for name, array in zip(values, arrays, strict=True):
        variables[VARIABLES.index(name)] = array
    mixed = np.tensordot(vehicle.effector_mix, variables[_AXIS_DEFLECTIONS], axes=1)
    variables[_FIRST_EFFECTOR : _FIRST_EFFECTOR + len(mixed)] = mixed
    return variables


def evaluate_tables(tables: Tables, variables: Floats) -> Floats:
    """Interpolate all tables [row, point] at variables [variable, point].

    Values are constant beyond the edges of the tables.
    """
    shape = variables.shape[1:]
    rows = np.empty((tables.n_rows, *shape))
    for g in range(tables.group_start.size):
        corners = [(np.ones(shape), np.full(shape, tables.group_start[g]))]
        for axis, stride in zip(tables.group_axis[g], tables.group_stride[g], strict=True):
            if stride == 0:
                continue
            first = tables.axis_start[axis]
            length = tables.axis_length[axis]
            grid = tables.grid[first : first + length]
            x = np.clip(variables[tables.axis_variable[axis]], grid[0], grid[-1])
            cell = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, length - 2)
            upper = (x - grid[cell]) / (grid[cell + 1] - grid[cell])
            corners = [
                (weight * share, node + (cell + side) * stride)
                for weight, node in corners
                for side, share in ((0, 1.0 - upper), (1, upper))
            ]
        first_row = tables.group_row[g]
        width = tables.group_width[g]
        within = np.arange(width).reshape(-1, *[1] * (variables.ndim - 1))
        rows[first_row : first_row + width] = sum(
            weight * tables.data[node + within] for weight, node in corners
        )
    return rows


def table_rows(tables: Tables, variables: Numbers) -> Numbers:
    """Interpolate all tables at variables that may be complex.

    A complex step gives the exact derivative within a table cell.
    """
    low = []
    weight = []
    for variable, start, length in zip(
        tables.axis_variable, tables.axis_start, tables.axis_length, strict=True
    ):
        grid = tables.grid[start : start + length]
        x = variables[variable]
        x = x if np.imag(x).any() else x.real
        cell = np.clip(np.searchsorted(grid, x.real, side="right") - 1, 0, length - 2)
        fraction = (x - grid[cell]) / (grid[cell + 1] - grid[cell])
        fraction = np.where(fraction.real < 0.0, 0.0, np.where(fraction.real > 1.0, 1.0, fraction))
        low.append(cell)
        weight.append(fraction)
    shape = variables.shape[1:]
    rows = np.zeros((tables.n_rows, *shape), np.result_type(*weight, np.float64))
    for group, width in enumerate(tables.group_width):
        axes = tables.group_axis[group]
        strides = tables.group_stride[group]
        used = [d for d in range(len(strides)) if strides[d]]
        node = np.full(shape, tables.group_start[group], np.int64)
        for d in used:
            node = node + low[axes[d]] * strides[d]
        column = np.arange(width).reshape((-1,) + (1,) * len(shape))
        value: Any = 0.0
        for corner in range(2 ** len(used)):
            share: Any = 1.0
            offset = 0
            for bit, d in enumerate(used):
                upper = corner >> bit & 1
                share = share * (weight[axes[d]] if upper else 1.0 - weight[axes[d]])
                offset += int(strides[d]) * upper
            value = value + share * tables.data[column + node + offset]
        row = int(tables.group_row[group])
        rows[row : row + width] = value
    return rows


def evaluate_coefficients(
    vehicle: Vehicle, variables: Numbers, factors: Floats | None = None, rows: Numbers | None = None
) -> Numbers:
    """Return the six COEFFICIENTS [coefficient, point] at variables [variable, point].

    ``factors`` [parameter] or [parameter, point] multiply the table terms; None means all 1.
    ``rows`` contains the interpolated tables if they have already been computed.
    """
    if vehicle.foreign.aerodynamics:
        return evaluate_functions(vehicle, variables)[0]
    rows = evaluate_tables(vehicle.tables, variables) if rows is None else rows
    coefficients = np.zeros(
        (len(COEFFICIENTS), *variables.shape[1:]), np.result_type(rows, variables)
    )
    for coefficient, row, variable, factor in zip(*vehicle.build_up, strict=True):
        term = rows[row] * variables[variable]
        coefficients[coefficient] += term if factors is None else factors[factor] * term
    return coefficients


def moment_about_center(
    vehicle: Vehicle, coefficients: Any, alpha: Any, fixed: dict[str, Any]
) -> Any:
    """Return the pitching-moment coefficient about the centre of gravity."""
    lift, drag, _, _, moment, _ = coefficients
    forward = lift * np.sin(alpha) - drag * np.cos(alpha)
    down = -lift * np.cos(alpha) - drag * np.sin(alpha)
    arm = fixed["center_of_gravity_x"] * down - fixed["center_of_gravity_z"] * forward
    return moment + arm / vehicle.constants.chord


def evaluate_fixed(
    vehicle: Vehicle, variables: Numbers, rows: Numbers | None = None
) -> dict[str, Numbers]:
    """Return propulsion and mass quantities [point] by their names in FIXED_TABLE_ROWS."""
    rows = evaluate_tables(vehicle.tables, variables) if rows is None else rows
    return {
        name: rows[row]
        for name, row in zip(FIXED_TABLE_ROWS, vehicle.tables.fixed_row, strict=True)
    }
