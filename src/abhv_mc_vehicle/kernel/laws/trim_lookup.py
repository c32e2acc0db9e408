"""Look-up of the trim tables in all lanes, and nominal controls along a trajectory.

Each lane keeps its cell of the tables from tick to tick. Nominal controls are computed by nested
Brent searches.

The searches solve equation (12) of Zhu and Shen (2014), section 4.3, with trim tables: they find
angle of attack, bank and equivalence ratio for given accelerations. The paper solves its three
equations in turn; its iteration of bank and angle of attack multiplies the error by ``-tan^2 bank``
and diverges if the bank exceeds 45 deg. Here, each residual of the second equation uses
the bank from the explicit third equation, and each residual of the first equation uses the angle of
attack that solves the second equation. Each search brackets the only root of a monotone function.
"""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc_vehicle.kernel.jit import kernel, lanes, routine, scalar
from abhv_mc_vehicle.kernel.numerics.root_finding import NO_SIGN_CHANGE, brent
from abhv_mc_vehicle.kernel.numerics.tables import bracket, mix, natural, weigh
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import aligned_zeros
from abhv_mc_vehicle.kernel.plant.vehicle import CHUNK

AXES = 3  # number of axes: Mach, angle of attack, equivalence ratio

# Quantities of the trim tables: unlimited elevator, rad; lift and drag coefficients; thrust divided
# by dynamic pressure and area; specific impulse, s.
TRIM_ROWS = ("elevator", "lift", "drag", "thrust", "specific_impulse")
ELEVATOR, LIFT, DRAG, THRUST, IMPULSE = range(len(TRIM_ROWS))


class TrimCells(NamedTuple):
    """Table cell of each lane on each axis, and buffers for the interpolated values."""

    cell: Ints  # cell of each lane [axis, lane]
    low: Floats  # [axis, lane] lower end of the cell
    high: Floats  # [axis, lane] upper end of the cell
    per_step: Floats  # [axis, lane] 1 / length of the cell
    fraction: Floats  # [axis, lane] position within the cell, as a fraction of its length
    value: Floats  # buffer of values [CHUNK]
    slope: Floats  # buffer of slopes [CHUNK]


def make_trim_cells(width: int) -> TrimCells:
    """Return memory for ``width`` lanes, with empty cells that make the first look-up search."""
    shapes: list[tuple[int, ...]] = [(AXES, width)] * 4 + [(CHUNK,)] * 2
    return TrimCells(aligned_zeros((AXES, width), np.int64), *map(aligned_zeros, shapes))


@lanes
def follow(Z, W, row, tables, axis, cells):
    """Update cell and fraction of every lane on one axis, searching only if necessary."""
    has_left = False
    for lane in range(W):
        x = Z[row, lane]
        low = cells.low[axis, lane]
        has_left |= not (low <= x < cells.high[axis, lane])
        cells.fraction[axis, lane] = (x - low) * cells.per_step[axis, lane]
    if has_left:
        start = natural(tables.axis_start[axis])
        end = start + natural(tables.axis_length[axis])
        grid = tables.grid[start:end]
        inverse_step = tables.inverse_step[start:end]
        for lane in range(W):
            i, t = bracket(grid, inverse_step, grid.size, cells.cell[axis, lane], Z[row, lane])
            cells.cell[axis, lane] = i
            cells.low[axis, lane] = grid[i]
            cells.high[axis, lane] = grid[i + 1]
            cells.per_step[axis, lane] = inverse_step[i]
            cells.fraction[axis, lane] = t


@scalar
def blend(data, corner, s0, s1, s2, t0, t1, t2, per_step, value, slope):
    """Interpolate all tables of a cell as one vector, with slopes along the middle axis."""
    weights = weigh(t0, t2)
    a = natural(corner)
    b = natural(corner + s0)
    c = natural(corner + s2)
    d = natural(corner + s0 + s2)
    e = natural(corner + s1)
    f = natural(corner + s1 + s0)
    g = natural(corner + s1 + s2)
    h = natural(corner + s1 + s0 + s2)
    for k in range(CHUNK):
        low = mix(weights, (data[a + k], data[b + k], data[c + k], data[d + k]))
        high = mix(weights, (data[e + k], data[f + k], data[g + k], data[h + k]))
        value[k] = (1.0 - t1) * low + t1 * high
        slope[k] = (high - low) * per_step


@lanes
def look_up_trim(Z, W, trim, cells, alpha_row, eta_row, first_row):
    """Look up trimmed lift, drag and thrust, and derivatives of lift and thrust by alpha.

    The five results are in the rows starting at ``first_row``. The tables depend on Mach number,
    angle of attack and equivalence ratio.
    """
    follow(Z, W, s.V_MACH, trim, 0, cells)
    follow(Z, W, alpha_row, trim, 1, cells)
    follow(Z, W, eta_row, trim, 2, cells)
    s0 = trim.group_stride[0, 0]
    s1 = trim.group_stride[0, 1]
    s2 = trim.group_stride[0, 2]
    start = trim.group_start[0]
    for lane in range(W):
        corner = (
            start + cells.cell[0, lane] * s0 + cells.cell[1, lane] * s1 + cells.cell[2, lane] * s2
        )
        t0 = cells.fraction[0, lane]
        t1 = cells.fraction[1, lane]
        t2 = cells.fraction[2, lane]
        blend(
            trim.data,
            corner,
            s0,
            s1,
            s2,
            t0,
            t1,
            t2,
            cells.per_step[1, lane],
            cells.value,
            cells.slope,
        )
        Z[first_row, lane] = cells.value[LIFT]
        Z[first_row + 1, lane] = cells.value[DRAG]
        Z[first_row + 2, lane] = cells.value[THRUST]
        Z[first_row + 3, lane] = cells.slope[LIFT]
        Z[first_row + 4, lane] = cells.slope[THRUST]


BANK_LIMIT = np.deg2rad(85.0)
X_TOLERANCE = 1e-11  # tolerance in angle of attack, rad, and in equivalence ratio
MAX_ITERATIONS = 100

# half widths of the shortened brackets about the previous solution: rad, and equivalence ratio
_NEAR_ALPHA = np.deg2rad(0.25)
_NEAR_ETA = 0.02

# Flags that are added to the status, which is 0 if all three equations are satisfied.
NO_EQUIVALENCE_RATIO = 1
NO_ANGLE_OF_ATTACK = 2
NO_BANK = 4
NO_ELEVATOR = 8


class GuidancePoints(NamedTuple):
    """Trim points with prescribed accelerations [point], in SI units and radians."""

    speed: Floats
    density: Floats
    sound_speed: Floats
    gravity: Floats
    radius: Floats  # radius r in V / r
    latitude: Floats
    flight_path_angle: Floats
    heading: Floats
    axial: Floats  # axial acceleration, N_a = V'
    longitudinal: Floats  # longitudinal acceleration, N_longi = V gamma'
    lateral: Floats  # lateral acceleration, N_lati = V chi'


class SearchBounds(NamedTuple):
    """Intervals of the searches, and the number of attempts."""

    alpha_low: float
    alpha_high: float
    eta_low: float
    eta_high: float
    elevator_low: float
    elevator_high: float
    # Number of attempts, which is 2 because a shortened bracket may fail. It is not a constant,
    # because numba would unroll the loop.
    searches: int


class _Demand(NamedTuple):
    mach: float
    q_area: float  # dynamic pressure times reference area, N
    axial: float  # force along the velocity, T cos - D, N
    vertical: float  # vertical force, (L + T sin) cos(bank), N
    lateral: float  # lateral force, (L + T sin) sin(bank), N
    thrust_cos: float
    thrust_sin: float


class Cut(NamedTuple):
    """Trim tables interpolated at one Mach number and one equivalence ratio, for searches."""

    alpha: Floats  # nodes of the angle of attack
    eta: Floats  # nodes of the equivalence ratio
    plane: Floats  # values at the Mach number [eta, alpha, TRIM_ROWS]
    line: Floats  # values at the equivalence ratio [alpha, TRIM_ROWS]


@routine
def _cut_at_mach(tables, mach, cut):
    """Interpolate the trim tables at a Mach number; store the result in ``cut.plane``."""
    start = tables.axis_start[0]
    length = tables.axis_length[0]
    nodes = tables.grid[start : start + length]
    inverse_step = tables.inverse_step[start : start + length]
    i, s = bracket(nodes, inverse_step, length, 0, mach)
    s0 = tables.group_stride[0, 0]
    s1 = tables.group_stride[0, 1]
    s2 = tables.group_stride[0, 2]
    for j in range(cut.alpha.size):
        for k in range(cut.eta.size):
            corner = tables.group_start[0] + i * s0 + j * s1 + k * s2
            for row in range(cut.line.shape[1]):
                cut.plane[k, j, row] = (1.0 - s) * tables.data[corner + row] + s * tables.data[
                    corner + s0 + row
                ]


@scalar
def _locate(nodes, x):
    """Return the cell of ``x`` among the nodes and the fraction of the cell, both clamped."""
    low = 0
    high = nodes.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if x < nodes[middle]:
            high = middle
        else:
            low = middle
    return low, min(max((x - nodes[low]) / (nodes[low + 1] - nodes[low]), 0.0), 1.0)


@routine
def _cut_at_eta(eta, cut):
    """Interpolate ``cut.plane`` at an equivalence ratio; store the result in ``cut.line``."""
    k, u = _locate(cut.eta, eta)
    for j in range(cut.alpha.size):
        for row in range(cut.line.shape[1]):
            cut.line[j, row] = (1.0 - u) * cut.plane[k, j, row] + u * cut.plane[k + 1, j, row]


@routine
def _look_up(alpha, row, cut):
    """Interpolate one of the TRIM_ROWS of ``cut.line`` at an angle of attack."""
    j, t = _locate(cut.alpha, alpha)
    return (1.0 - t) * cut.line[j, row] + t * cut.line[j + 1, row]


# Each level has its own compiled search, because numba treats nested searches as recursion.
_brent_alpha = scalar(brent.py_func)  # type: ignore[attr-defined]
_brent_eta = scalar(brent.py_func)  # type: ignore[attr-defined]


@scalar
def _sin_bank_of(normal, lateral):
    """Return the sine of the bank from the third equation, limited to BANK_LIMIT."""
    limit = np.sin(BANK_LIMIT)
    sine = lateral / normal if normal > 0.0 else np.copysign(limit, lateral)
    return min(max(sine, -limit), limit)


@routine
def _normal_force(alpha, cut, expected):
    """Return the normal force L + T sin(alpha + e), N."""
    j, t = _locate(cut.alpha, alpha)
    lift = (1.0 - t) * cut.line[j, LIFT] + t * cut.line[j + 1, LIFT]
    thrust = (1.0 - t) * cut.line[j, THRUST] + t * cut.line[j + 1, THRUST]
    return expected.q_area * (
        lift + thrust * (np.sin(alpha) * expected.thrust_cos + np.cos(alpha) * expected.thrust_sin)
    )


@routine
def _alpha_residual(alpha, cut, expected):
    normal = _normal_force(alpha, cut, expected)
    sine = _sin_bank_of(normal, expected.lateral)
    return normal * np.sqrt(1.0 - sine * sine) - expected.vertical


@routine
def _alpha_of(eta, near, margin, cut, expected, bounds):
    """Solve the second and third equations together; return angle of attack and status.

    On return, ``cut.line`` contains the values at ``eta``.
    """
    _cut_at_eta(eta, cut)
    low = max(bounds.alpha_low, near - margin)
    high = min(bounds.alpha_high, near + margin)
    root = near
    status = NO_SIGN_CHANGE
    for _ in range(bounds.searches):
        root, _, status = _brent_alpha(
            _alpha_residual, (cut, expected), low, high, X_TOLERANCE, MAX_ITERATIONS
        )
        if status != NO_SIGN_CHANGE:
            break
        low = bounds.alpha_low
        high = bounds.alpha_high
    return root, status


@routine
def _eta_residual(eta, near_alpha, margin, cut, expected, bounds):
    alpha, _ = _alpha_of(eta, near_alpha, margin, cut, expected, bounds)
    cos_thrust = np.cos(alpha) * expected.thrust_cos - np.sin(alpha) * expected.thrust_sin
    return (
        expected.q_area * (_look_up(alpha, THRUST, cut) * cos_thrust - _look_up(alpha, DRAG, cut))
        - expected.axial
    )


@routine
def _eta_of(near, margin, near_alpha, alpha_margin, cut, expected, bounds):
    """Solve all three equations; return equivalence ratio and status."""
    low = max(bounds.eta_low, near - margin)
    high = min(bounds.eta_high, near + margin)
    root = near
    status = NO_SIGN_CHANGE
    arguments = (near_alpha, alpha_margin, cut, expected, bounds)
    for _ in range(bounds.searches):
        root, _, status = _brent_eta(
            _eta_residual, arguments, low, high, X_TOLERANCE, MAX_ITERATIONS
        )
        if status != NO_SIGN_CHANGE:
            break
        low = bounds.eta_low
        high = bounds.eta_high
    return root, status


@kernel
def fill_trim(tables, constants, points, mass, tick, fixed_eta, warm, bounds, cut, solution):
    """Compute the ``solution`` [point, 6] of ``control.design.guidance_trim.trim_along``."""
    near_eta = 0.5 * (bounds.eta_low + bounds.eta_high)
    eta_margin = bounds.eta_high - bounds.eta_low
    near_alpha = 0.5 * (bounds.alpha_low + bounds.alpha_high)
    alpha_margin = bounds.alpha_high - bounds.alpha_low
    for k in range(points.speed.size):
        speed = points.speed[k]
        gamma = points.flight_path_angle[k]
        chi = points.heading[k]
        gravity = points.gravity[k]
        radius = points.radius[k]
        cos_gamma = np.cos(gamma)
        turn = speed * speed * cos_gamma * np.sin(chi) * np.tan(points.latitude[k]) / radius
        expected = _Demand(
            speed / points.sound_speed[k],
            0.5 * points.density[k] * speed * speed * constants.area,
            mass * (points.axial[k] + gravity * np.sin(gamma)),
            mass * (points.longitudinal[k] - (speed * speed / radius - gravity) * cos_gamma),
            mass * (points.lateral[k] - turn) * cos_gamma,
            constants.thrust_cos,
            constants.thrust_sin,
        )
        _cut_at_mach(tables, expected.mach, cut)
        eta = fixed_eta
        status = 0
        if fixed_eta < 0.0:
            eta, search_status = _eta_of(
                near_eta, eta_margin, near_alpha, alpha_margin, cut, expected, bounds
            )
            status += NO_EQUIVALENCE_RATIO if search_status != 0 else 0
        alpha, search_status = _alpha_of(eta, near_alpha, alpha_margin, cut, expected, bounds)
        status += NO_ANGLE_OF_ATTACK if search_status != 0 else 0
        normal = _normal_force(alpha, cut, expected)
        sine = _sin_bank_of(normal, expected.lateral)
        status += NO_BANK if abs(normal * sine - expected.lateral) > 1e-9 * abs(normal) else 0
        elevator = _look_up(alpha, ELEVATOR, cut)
        limited = min(max(elevator, bounds.elevator_low), bounds.elevator_high)
        status += NO_ELEVATOR if elevator != limited else 0
        solution[k, 0] = alpha
        solution[k, 1] = np.arcsin(sine)
        solution[k, 2] = eta
        solution[k, 3] = limited
        solution[k, 4] = mass
        solution[k, 5] = status
        if warm:
            near_eta = eta
            eta_margin = _NEAR_ETA
            near_alpha = alpha
            alpha_margin = _NEAR_ALPHA
        if tick > 0.0:
            thrust = expected.q_area * _look_up(alpha, THRUST, cut)
            impulse = _look_up(alpha, IMPULSE, cut)  # zero for an engine that does not run
            burns = impulse > 0.0 and constants.burns_fuel > 0.0
            burnt = thrust / (constants.standard_gravity * impulse) * tick if burns else 0.0
            mass = max(mass - burnt, constants.mass_empty)
