"""Vehicles of the class of GHAME with the paper's S: free parameters, their box and tables.

The base is `ghame_x` (CADAC++ GHAME6, P. H. Zipfel, at a smaller size) with `HEAVIER` times its
mass and inertias, and a wing loading of 393 kg/m2. The inertias follow GHAME's straight line over
mass, but the fuel is GHAME's volume of hydrogen at this size, about 2 m3. Most free parameters are
factors on GHAME's coefficients. Comments give the corresponding factors of the winged cone (NASA
TM-102610, `winged_cone.yaml`) relative to GHAME at the Mach number and angle of attack of the S,
with full tanks and inertias over mass times area. Yaw by aileron, roll rate and yaw rate has the
sign of both vehicles.

Drag is a polar, `CD = CD0 g(M) + k |CL tan(alpha - alpha_0)|`: `alpha_0` is the zero-lift angle of
a straight line through CL below 10 deg at a Mach number, and `g` is GHAME's drag at 3 deg relative
to its value at Mach 4.744. Further requirements of the class (`paper_vehicle_sides.py`) limit
combinations of these parameters.

The size is constant. A common factor on inertias, moment tables and offsets changes no simulation,
nor does one on mass, inertias, all coefficients and the cowl area.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from experiment import ROOT, Floats

from abhv_mc_vehicle.control.mission import Mission, read_mission
from abhv_mc_vehicle.kernel.plant.vehicle import (
    COEFFICIENTS,
    FIXED_TABLE_ROWS,
    VARIABLES,
    Tables,
    Vehicle,
)
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.vehicle_code import make_variables, table_rows

MACH, ALPHA = 4.744, 3.5  # of the S (deg), for ratios of coefficients
TABLES = {  # table of the vehicle file -> coefficient, and variable that it multiplies
    "lift_basic": ("lift", "one"),
    "lift_elevator": ("lift", "elevator"),
    "drag_basic": ("drag", "one"),
    "side_sideslip": ("side_force", "sideslip"),
    "side_aileron": ("side_force", "aileron"),
    "side_rudder": ("side_force", "rudder"),
    "roll_sideslip": ("rolling_moment", "sideslip"),
    "roll_aileron": ("rolling_moment", "aileron"),
    "roll_rudder": ("rolling_moment", "rudder"),
    "roll_roll_rate": ("rolling_moment", "roll_rate_hat"),
    "pitch_basic": ("pitching_moment", "one"),
    "pitch_elevator": ("pitching_moment", "elevator"),
    "pitch_pitch_rate": ("pitching_moment", "pitch_rate_hat"),
    "yaw_sideslip": ("yawing_moment", "sideslip"),
    "yaw_aileron": ("yawing_moment", "aileron"),
    "yaw_rudder": ("yawing_moment", "rudder"),
    "yaw_roll_rate": ("yawing_moment", "roll_rate_hat"),
    "yaw_yaw_rate": ("yawing_moment", "yaw_rate_hat"),
    "roll_yaw_rate": ("rolling_moment", "yaw_rate_hat"),
}


@dataclass(frozen=True)
class Free:
    """Free parameter: its range, and the smaller range from which a search draws its start."""

    low: float
    high: float
    first: tuple[float, float]
    logarithmic: bool = True


def _signed(low: float, high: float, first: tuple[float, float]) -> Free:
    return Free(low, high, first, False)


HEAVIER = 2.3  # mass and inertias over those of ghame_x
FUEL = 140.0  # kg with full tanks: GHAME's 81646 kg times 0.12^3; half of it at the start
ALPHA_LIMIT = np.deg2rad(15.0)  # the upper limit of the angle of attack
FREE = {
    "inertia_xx": Free(0.5, 3.0, (0.9, 1.6)),  # cone 1.13
    "inertia_yy": Free(0.7, 1.4, (0.9, 1.3)),  # cone 0.61
    "inertia_zz": Free(0.9, 1.12, (1.02, 1.08)),  # of the pitch inertia's factor; cone 0.96
    "inertia_matrix_element_13": _signed(-1.0, 2.0, (-1.0, 0.0)),
    "roll_aileron": Free(0.9, 9.2, (3.0, 4.8)),  # cone 1.05
    "yaw_aileron": _signed(0.0, 5.8, (4.8, 5.7)),  # cone 1.39
    "side_aileron": _signed(-6.9, 11.5, (-5.0, -2.5)),  # cone 0.01
    # Roll by the rudder over roll by the aileron; GHAME 0.48, cone 0.38.
    "roll_rudder": _signed(-0.8, 0.8, (0.68, 0.8)),
    # Yaw by the rudder over yaw by sideslip; GHAME 0.04, cone 0.90.
    "yaw_rudder": Free(0.05, 1.6, (1.5, 1.6)),
    "side_rudder": Free(0.7, 8.0, (4.8, 7.0)),  # cone 0.67
    "pitch_elevator": Free(0.7, 9.2, (1.6, 3.4)),  # cone 3.76
    "lift_elevator": Free(0.7, 6.9, (0.75, 1.6)),  # cone 3.72
    "roll_sideslip": Free(0.5, 18.4, (6.0, 12.0)),  # cone 8.36
    "yaw_sideslip": Free(0.2, 2.5, (0.23, 0.35)),  # cone -0.09
    "side_sideslip": Free(0.9, 5.8, (1.2, 1.65)),  # cone 1.52
    "roll_roll_rate": Free(0.3, 6.9, (0.8, 1.3)),  # cone 1.40
    "pitch_pitch_rate": Free(0.3, 6.9, (1.1, 1.5)),  # cone 0.25
    "yaw_yaw_rate": Free(0.7, 7.5, (5.0, 6.8)),  # cone 8.31
    "yaw_roll_rate": _signed(0.0, 4.6, (0.0, 1.5)),  # cone 5.62
    "lift_basic": Free(0.6, 1.4, (0.7, 0.9)),  # cone 1.33
    "lift_offset": _signed(-0.01, 0.06, (0.034, 0.041)),  # CL
    "pitch_offset": _signed(-0.0035, 0.0035, (-0.0002, 0.0003)),  # Cm
    "pitch_slope": _signed(-0.0014, 0.0007, (-0.0002, 0.0)),  # Cm per deg
    "drag_zero_lift": Free(0.0025, 0.028, (0.0036, 0.0044)),  # CD0 at the Mach number of the S
    "drag_tilt": Free(1.0, 2.0, (1.62, 1.8)),  # k
    "cowl_area": Free(0.1, 3.2, (0.29, 0.36)),
    "thrust_arm": _signed(-8.0, 12.0, (4.5, 5.2)),
    "length": _signed(45.0, 59.0, (53.0, 54.2)),  # of the S, s
    "bank_time": Free(0.7, 4.0, (1.7, 2.4)),  # s
    "sharpness": Free(1.0, 3.0, (1.5, 1.6)),
}
FIXED = {"pitch_basic": HEAVIER, "roll_yaw_rate": HEAVIER}  # factors
_INERTIAS = {f"inertia_{axes}": f"inertia_{axes}" for axes in ("xx", "yy", "zz")}
_INERTIAS["inertia_matrix_element_13"] = "inertia_13"
_ENTRIES = _INERTIAS | {"capture_area_ratio": "capture_area_ratio"}  # of FIXED_TABLE_ROWS
MISSION = ("length", "bank_time", "sharpness")


_GHAME_X = load_vehicle(ROOT / "configs/vehicle/ghame_x.yaml")
BASE_MISSION = read_mission(ROOT / "configs/mission/s_manoeuvre.yaml")


def first_mean(generator: np.random.Generator) -> dict[str, float]:
    """Draw the start of a search."""
    drawn = {}
    for name, free in FREE.items():
        low, high = free.first
        drawn[name] = float(
            np.exp(generator.uniform(np.log(low), np.log(high)))
            if free.logarithmic
            else generator.uniform(low, high)
        )
    return drawn


def to_numbers(values: dict[str, float]) -> Floats:
    """Return values as numbers of the search, whose unit is a third of the first range."""
    return np.array(
        [(_scaled(f, values[n]) - _scaled_middle(f)) / _unit(f) for n, f in FREE.items()]
    )


def to_values(numbers: Floats) -> dict[str, float]:
    """Return values limited to the box."""
    values = {}
    for (name, free), number in zip(FREE.items(), numbers, strict=True):
        x = _scaled_middle(free) + _unit(free) * float(number)
        values[name] = float(np.clip(np.exp(x) if free.logarithmic else x, free.low, free.high))
    return values


def limits() -> tuple[Floats, Floats]:
    """Return the box in numbers of the search."""
    low, high = (
        {name: getattr(free, end) for name, free in FREE.items()} for end in ("low", "high")
    )
    return to_numbers(low), to_numbers(high)


def _scaled(free: Free, value: float) -> float:
    return float(np.log(value)) if free.logarithmic else value


def _scaled_middle(free: Free) -> float:
    return 0.5 * (_scaled(free, free.first[0]) + _scaled(free, free.first[1]))


def _unit(free: Free) -> float:
    return (_scaled(free, free.first[1]) - _scaled(free, free.first[0])) / 3.0


def _row_of(name: str) -> int:
    """Return the packed row of a table or an inertia."""
    if name in _ENTRIES:
        return int(_GHAME_X.tables.fixed_row[FIXED_TABLE_ROWS.index(_ENTRIES[name])])
    indices = COEFFICIENTS.index(TABLES[name][0]), VARIABLES.index(TABLES[name][1])
    terms = zip(
        _GHAME_X.build_up.coefficient,
        _GHAME_X.build_up.table,
        _GHAME_X.build_up.variable,
        strict=True,
    )
    return next(
        int(row) for coefficient, row, variable in terms if (coefficient, variable) == indices
    )


def _axes_of(
    row: int, tables: Tables = _GHAME_X.tables
) -> tuple[int, list[int], list[tuple[str, Floats]]]:
    """Return the index of a row's first node in the packed data, strides and axes.

    An axis has a variable and nodes.
    """
    group = max(np.flatnonzero(tables.group_row <= row), key=lambda g: tables.group_row[g])
    used = [d for d in range(3) if tables.group_stride[group][d]]
    axes = []
    for axis in tables.group_axis[group][used]:
        first = tables.axis_start[axis]
        nodes = tables.grid[first : first + tables.axis_length[axis]]
        axes.append((VARIABLES[tables.axis_variable[axis]], nodes))
    first = int(tables.group_start[group] + row - tables.group_row[group])
    return first, [int(tables.group_stride[group][d]) for d in used], axes


def _cells_of(name: str) -> tuple[Any, Floats]:
    """Return the indices [axis, ...] of a table's nodes, and their angle of attack in deg."""
    first, strides, axes = _axes_of(_row_of(name))
    node = np.indices([nodes.size for _, nodes in axes])
    cells = first + sum(stride * i for stride, i in zip(strides, node, strict=True))
    alpha = np.zeros(node[0].shape)
    for i, (variable, nodes) in zip(node, axes, strict=True):
        if variable == "angle_of_attack":
            alpha = np.rad2deg(nodes[i])
    return cells, alpha


def grids_of(name: str) -> list[Floats]:
    """Return the nodes of a table's axes: Mach number and angle of attack (rad)."""
    return [nodes for _, nodes in _axes_of(_row_of(name), BASE.tables)[2]]


def cells_of(name: str) -> Any:
    """Return the indices of a table's nodes in the packed data."""
    return _cells_of(name)[0]


_CELLS = {name: _cells_of(name) for name in (*TABLES, *_INERTIAS)}


def _make_base() -> Vehicle:
    """Return `ghame_x` with mass and inertias times HEAVIER and its limit of angle of attack."""
    constants, tables, factor = _GHAME_X.constants, _GHAME_X.tables, HEAVIER
    constants = constants._replace(
        mass_start=factor * constants.mass_start,
        mass_empty=factor * constants.mass_start - 0.5 * FUEL,
        angle_of_attack_max=ALPHA_LIMIT,
    )
    grid, inverse_step, data = tables.grid.copy(), tables.inverse_step.copy(), tables.data.copy()
    (axis,) = np.flatnonzero(tables.axis_variable == VARIABLES.index("mass"))
    nodes = slice(tables.axis_start[axis], tables.axis_start[axis] + tables.axis_length[axis])
    grid[nodes] *= factor
    inverse_step[nodes] /= factor
    for name in _INERTIAS:
        data[_CELLS[name][0]] *= factor
    tables = tables._replace(grid=grid, inverse_step=inverse_step, data=data)
    return _GHAME_X._replace(constants=constants, tables=tables)


BASE = _make_base()
_ROWS = table_rows(BASE.tables, make_variables(BASE, mach=MACH, angle_of_attack=np.deg2rad(ALPHA)))


def _at_s(name: str) -> float:
    """Return GHAME's coefficient in the S, per rad."""
    return float(_ROWS[_row_of(name), 0])


_RUDDER_ROLL = _at_s("roll_rudder") / _at_s("roll_aileron")
_RUDDER_YAW = abs(_at_s("yaw_rudder") / _at_s("yaw_sideslip"))


_MACHS, _ALPHAS = grids_of("drag_basic")
_DRAG_AT_3 = np.array(
    [np.interp(np.deg2rad(3.0), _ALPHAS, row) for row in BASE.tables.data[_CELLS["drag_basic"][0]]]
)
_DRAG_OVER_MACH = _DRAG_AT_3 / np.interp(MACH, _MACHS, _DRAG_AT_3)


def factors_of(values: dict[str, float]) -> dict[str, float]:
    """Return the factors on GHAME's tables and inertias.

    The inertias are limited to those of a rigid body at both mass points.
    """
    factors = {name: (FIXED | values).get(name, 1.0) for name in _CELLS}
    factors["roll_rudder"] = values["roll_rudder"] * values["roll_aileron"] / _RUDDER_ROLL
    factors["yaw_rudder"] = values["yaw_rudder"] * values["yaw_sideslip"] / _RUDDER_YAW
    at_ends = {name: BASE.tables.data[_CELLS[name][0]].ravel() for name in _INERTIAS}
    roll, pitch, yaw, product = at_ends.values()
    most = float((0.995 * (roll * values["inertia_xx"] + pitch * values["inertia_yy"]) / yaw).min())
    factors["inertia_zz"] = min(values["inertia_zz"] * values["inertia_yy"], most)
    room = (
        0.5 * np.sqrt(roll * values["inertia_xx"] * yaw * factors["inertia_zz"]) / np.abs(product)
    )
    factors["inertia_matrix_element_13"] = float(
        np.clip(values["inertia_matrix_element_13"], -room.min(), room.min())
    )
    return factors


def changed_tables(values: dict[str, float]) -> dict[str, Floats]:
    """Return the nodes of every table and inertia of a vehicle, per rad."""
    nodes = {}
    for name, factor in factors_of(values).items():
        nodes[name] = factor * BASE.tables.data[_CELLS[name][0]]
    alpha = _CELLS["pitch_basic"][1]
    nodes["lift_basic"] += values["lift_offset"]
    nodes["pitch_basic"] += values["pitch_offset"] + values["pitch_slope"] * (alpha - 3.0)
    nodes["drag_basic"] = _drag_polar(nodes["lift_basic"], values)
    return nodes


def _drag_polar(lift: Floats, values: dict[str, float]) -> Floats:
    """Return CD [Mach, angle of attack] of a lift table on the same nodes."""
    alpha = np.deg2rad(_CELLS["lift_basic"][1])
    straight = alpha[0] < np.deg2rad(10.0)
    slope, offset = np.polyfit(alpha[0, straight], lift[:, straight].T, 1)
    zero_lift = -offset / slope
    induced = np.abs(lift * np.tan(alpha - zero_lift[:, None]))
    return values["drag_zero_lift"] * _DRAG_OVER_MACH[:, None] + values["drag_tilt"] * induced


def make_vehicle(values: dict[str, float]) -> Vehicle:
    """Return the vehicle with changed tables."""
    data = BASE.tables.data.copy()
    for name, nodes in changed_tables(values).items():
        data[_CELLS[name][0]] = nodes
    c = BASE.constants
    constants = c._replace(
        thrust_offset_z=c.thrust_offset_z * values["thrust_arm"],
        capture_thrust=c.capture_thrust * values["cowl_area"],
    )
    return BASE._replace(constants=constants, tables=BASE.tables._replace(data=data))


def make_mission(values: dict[str, float]) -> Mission:
    """Return the S that starts to the right."""
    s = BASE_MISSION.manoeuvre.model_copy(
        update={"offset": -5000.0} | {name: values[name] for name in MISSION}
    )
    return BASE_MISSION.model_copy(update={"manoeuvre": s})
