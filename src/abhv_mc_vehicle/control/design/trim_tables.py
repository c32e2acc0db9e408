"""Trim tables for guidance: the vehicle's data at zero pitching moment."""

from itertools import pairwise
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.control.design.design_model import Environment, engine_at, thrust_at, wrench_at
from abhv_mc_vehicle.kernel.laws.trim_lookup import TRIM_ROWS
from abhv_mc_vehicle.kernel.plant.vehicle import CHUNK, FIXED_TABLE_ROWS, VARIABLES, Tables, Vehicle
from abhv_mc_vehicle.kernel.world.earth import standard_air
from abhv_mc_vehicle.plant.trim import nominal_air
from abhv_mc_vehicle.vehicle.actuators import deflection_range
from abhv_mc_vehicle.vehicle.table_file import Axis, Table, nodes_of, pack_tables
from abhv_mc_vehicle.vehicle.vehicle_code import (
    evaluate_coefficients,
    evaluate_fixed,
    make_variables,
    table_rows,
)

# Largest cell sizes for which errors are below 0.0005 deg in angle of attack and 0.01 deg in
# elevator deflection.
LONGEST = {"mach": 0.25, "angle_of_attack": np.deg2rad(1.0), "equivalence_ratio": 0.0625}
# smallest length of Mach cells that are shortened to avoid nodes at steady Mach numbers
_SHORTEST = 0.04

_ANGLES_OF_ATTACK = np.deg2rad([-10.0, 30.0])


def make_trim_tables(
    vehicle: Vehicle,
    altitude: float,
    speed_range: tuple[float, float],
    steady_mach: Floats | None = None,
    air: Floats | None = None,
) -> Tables:
    """Pack the trim tables over Mach number, angle of attack and equivalence ratio.

    The tables apply at ``altitude`` (m) and the speed of sound of the nominal ``air``; the density
    cancels if the thrust is proportional to it. T / (q_bar S) of an air-breathing engine is
    proportional to 1 / V, which at constant Mach number changes by 2 % in 10 km. ``speed_range``
    (m/s) is widened by a tenth on each side. The elevator may exceed the vehicle's limits, so that
    interpolation near a limit is as accurate as elsewhere. ``steady_mach`` contains constant Mach
    numbers of the reference, by default those at the ends of ``speed_range``. No node is within a
    quarter of a cell of these numbers, because slopes, and hence gains, would be one-sided at a
    node.
    """
    constants = vehicle.constants
    density = standard_air(altitude)[0]
    sound_speed = float(nominal_air(air, altitude)[1])
    low = 0.9 * speed_range[0] / sound_speed
    high = 1.1 * speed_range[1] / sound_speed
    alpha_low = max(_ANGLES_OF_ATTACK[0], constants.angle_of_attack_min)
    alpha_high = min(_ANGLES_OF_ATTACK[1], constants.angle_of_attack_max)
    if steady_mach is None:
        steady_mach = np.unique(speed_range) / sound_speed
    axes = (
        _axis(vehicle.tables, "mach", low, high, steady_mach),
        _axis(vehicle.tables, "angle_of_attack", alpha_low, alpha_high),
        _axis(
            vehicle.tables,
            "equivalence_ratio",
            constants.equivalence_ratio_min,
            constants.equivalence_ratio_max
            # The tables of a glider are equal at both ends of the axis of the equivalence ratio.
            or LONGEST["equivalence_ratio"],
        ),
    )
    mach, alpha, eta = (
        x.ravel() for x in np.meshgrid(*(axis.grid for axis in axes), indexing="ij")
    )
    environment = Environment(altitude, density, sound_speed, 0.0, 0.0, 0.0)
    elevator = trim_elevator(vehicle, environment, mach * sound_speed, alpha, eta)

    variables = make_variables(
        vehicle,
        mach=mach,
        angle_of_attack=alpha,
        equivalence_ratio=eta,
        elevator=elevator,
        altitude=altitude,
        mass=constants.mass_start,
    )
    rows = table_rows(vehicle.tables, variables)
    fixed = evaluate_fixed(vehicle, variables, rows)
    lift, drag, *_ = evaluate_coefficients(vehicle, variables, rows=rows)
    speed = mach * sound_speed
    q_area = 0.5 * density * speed**2 * constants.area
    thrust = thrust_at(vehicle, fixed, eta, density, speed) / q_area
    impulse = fixed["specific_impulse"]
    # thrust along the body x axis; the component normal to it is added to lift and drag
    if vehicle.foreign.propulsion:
        engine = engine_at(vehicle, variables, density, speed) / q_area
        thrust = engine[0]
        lift = lift - engine[2] * np.cos(alpha)
        drag = drag - engine[2] * np.sin(alpha)
        flow = engine[6] * q_area
        force = engine[0] * q_area
        burns = flow > 0.0
        impulse = np.where(
            burns, force / (constants.standard_gravity * np.where(burns, flow, 1.0)), 0.0
        )
    shape = tuple(axis.grid.size for axis in axes)
    values = (
        elevator,
        lift,
        drag,
        thrust,
        impulse,
        np.zeros(mach.size),
    )
    return _pack(axes, [np.ascontiguousarray(value).reshape(shape) for value in values])


def rebuild_trim_tables(grid: Floats, inverse_step: Floats, data: Floats) -> Tables:
    """Rebuild trim tables from stored numbers. Raise ValueError if the sizes do not match."""
    grids = np.split(grid, np.flatnonzero(inverse_step == 0.0) + 1)[
        : len(LONGEST)
    ]  # A value of 0 marks the last node of an axis.
    axes = tuple(
        Axis(VARIABLES.index(name), nodes) for name, nodes in zip(LONGEST, grids, strict=True)
    )
    if any(axis.grid.size < 2 for axis in axes):
        raise ValueError("trim_tables: an axis has fewer than two nodes")
    nodes = data.reshape(*(axis.grid.size for axis in axes), CHUNK)
    return _pack(axes, [np.ascontiguousarray(nodes[..., i]) for i in range(len(TRIM_ROWS) + 1)])


def _pack(axes: tuple[Axis, ...], values: list[Floats]) -> Tables:
    """Pack the tables of TRIM_ROWS, and a table of zeros for unused quantities."""
    impulse = TRIM_ROWS.index("specific_impulse")
    zero = len(TRIM_ROWS)
    fixed_entries = {
        name: impulse if name == "specific_impulse" else zero for name in FIXED_TABLE_ROWS
    }
    packed, packed_rows = pack_tables([Table(axes, value) for value in values], fixed_entries)
    if not np.array_equal(packed_rows, np.arange(len(values))):
        raise RuntimeError("trim rows are not packed in order")
    return packed


def trim_elevator(
    vehicle: Vehicle, environment: Environment, speed: Floats, alpha: Floats, eta: Floats
) -> Floats:
    """Return the elevator (rad) for zero pitching moment at each point.

    Within the limits, the solution is found by Chandrupatla's method. If the moment has the same
    sign at both limits, the elevator is extrapolated linearly, by at most 90 deg, beyond the limit
    with the smaller moment.
    """
    from scipy.optimize import elementwise

    mass = vehicle.constants.mass_start
    low, high = deflection_range(vehicle, 2)

    def pitching_moment(elevator: Any, speed: Any, alpha: Any, eta: Any) -> Any:
        zero = np.zeros_like(speed)
        rates = (zero, zero, zero)
        deflections = (zero, zero, elevator)
        wrench = wrench_at(vehicle, environment, mass, speed, alpha, zero, rates, deflections, eta)
        return wrench.moment[1] / (
            environment.density * speed**2 * vehicle.constants.area * vehicle.constants.chord
        )

    at_low, at_high = (
        pitching_moment(np.full_like(speed, limit), speed, alpha, eta) for limit in (low, high)
    )
    with np.errstate(divide="ignore", invalid="ignore"):  # The elevator may have no effect.
        secant = low - at_low * (high - low) / (at_high - at_low)
    nearer_low = np.abs(at_low) < np.abs(at_high)
    lowest = low - 0.5 * np.pi
    highest = high + 0.5 * np.pi
    farthest = np.where(nearer_low, lowest, highest)
    elevator = np.where(np.isfinite(secant), secant, farthest).clip(lowest, highest)
    bracketed = np.sign(at_low) * np.sign(at_high) <= 0.0
    if bracketed.any():
        elevator[bracketed] = elementwise.find_root(
            pitching_moment,
            (low, high),
            args=(speed[bracketed], alpha[bracketed], eta[bracketed]),
            tolerances={"xatol": 1e-13},
        ).x
    return elevator


def _axis(tables: Tables, name: str, low: float, high: float, steady: Floats | None = None) -> Axis:
    """Return an axis with the nodes of the vehicle's tables and cells no longer than LONGEST.

    Cells are shortened until each ``steady`` value is in the middle half of its cell. Nodes within
    half of _SHORTEST of a steady value are omitted.
    """
    nodes = nodes_of(tables, name)
    nodes = nodes[(nodes > low) & (nodes < high)]
    steady = np.zeros(0) if steady is None else steady
    distance = np.abs(nodes[:, None] - steady)
    crossed = steady[(distance < 0.5 * _SHORTEST).any(axis=0)]
    nodes = nodes[(distance >= 0.5 * _SHORTEST).all(axis=1)]
    across = np.concatenate([crossed - 0.5 * _SHORTEST, crossed + 0.5 * _SHORTEST])
    ends = np.unique(np.round([low, high, *nodes, *across], 12))
    cells_of = [ends[:1]]
    for left, right in pairwise(ends):
        fewest = max(1, int(np.ceil((right - left) / LONGEST[name] - 1e-9)))
        inside = steady[(steady > left) & (steady < right)]
        cells = _count_cells(fewest, (inside - left) / (right - left), right - left)
        cells_of.append(np.linspace(left, right, cells + 1)[1:])
    return Axis(VARIABLES.index(name), np.concatenate(cells_of))


def _count_cells(fewest: int, steady: Floats, length: float) -> int:
    """Return the smallest cell count with each steady value in the middle half of a cell.

    ``steady`` contains fractions of the length. If no cell count satisfies this condition, return
    the best count for which cells are not shorter than _SHORTEST.
    """
    if not steady.size:
        return fewest
    counts = np.arange(fewest, max(fewest, int(length / _SHORTEST)) + 1)
    fraction = np.outer(counts, steady) % 1.0
    margin = np.minimum(fraction, 1.0 - fraction).min(axis=1)
    return int(counts[np.argmax(margin >= min(0.2501, margin.max()))])
