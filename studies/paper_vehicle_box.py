"""Vehicles near `ghame_x` with the paper's S: what is free, within which box, and the tables scaled in memory.

A side is a ratio or a factor on `ghame_x` (CADAC++ GHAME6, P. H. Zipfel, at a smaller size), which is at 1. Beside it
stands the winged cone (NASA TM-102610, by `winged_cone.yaml`), computed like GHAME at the S's Mach number and angle of
attack, full, inertias over mass times area. Only these two were computed; HL-20, X-43A and X-51A were not checked.
The sides are judgement; most hold both vehicles. GHAME's rudder yaws less than its side asks, and the cone is out with
its instability in yaw, less pitch inertia and damping, more lift slope, lift by the elevator and roll by sideslip, and
far more yaw by roll rate and by yaw rate. Yaw by aileron, roll rate and yaw rate keeps the sign that both have.
Mass and size stay: inertias, moment tables and offsets doubled together change no number.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from experiment import ROOT, Floats

from abhv_mc.control.mission import Mission, read_mission
from abhv_mc.kernel.plant.vehicle import COEFFICIENTS, FIXED_TABLE_ROWS, VARIABLES, Vehicle
from abhv_mc.user_code.vehicle_functions import load_vehicle
from abhv_mc.vehicle.evaluate import make_variables, table_rows

MACH, ALPHA = 4.744, 3.5  # of the S, deg: where ratios of coefficients are taken
TABLES = {  # the vehicle file's table: its coefficient and what it multiplies
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
}


@dataclass(frozen=True)
class Free:
    """One free number: where it may lie, and from where a search draws its first mean (a smaller range)."""

    low: float
    high: float
    first: tuple[float, float]
    logarithmic: bool = True


def _signed(low: float, high: float, first: tuple[float, float]) -> Free:
    return Free(low, high, first, False)


FREE = {
    "inertia_xx": Free(0.5, 3.0, (0.6, 2.0)),  # cone 1.13
    "inertia_yy": Free(0.7, 1.4, (0.72, 1.1)),  # cone 0.61
    "inertia_zz": Free(0.9, 1.12, (0.95, 1.08)),  # of the pitch inertia's factor; cone 0.96
    "inertia_matrix_element_13": _signed(-1.0, 2.0, (0.0, 1.2)),
    "roll_aileron": Free(0.4, 4.0, (0.8, 2.5)),  # cone 1.05
    "yaw_aileron": _signed(0.0, 2.5, (0.3, 2.0)),  # cone 1.39
    "side_aileron": _signed(-3.0, 5.0, (0.0, 1.5)),  # cone 0.01
    "roll_rudder": _signed(
        -0.8, 0.8, (0.0, 0.7)
    ),  # roll by the rudder over roll by the aileron; GHAME 0.48, cone 0.38
    "yaw_rudder": Free(
        0.05, 1.6, (0.4, 1.4)
    ),  # yaw by the rudder over yaw by sideslip; GHAME 0.04, cone 0.90
    "side_rudder": Free(0.3, 3.0, (0.5, 1.5)),  # cone 0.67
    "pitch_elevator": Free(0.3, 4.0, (0.6, 2.0)),  # cone 3.76
    "lift_elevator": Free(0.3, 3.0, (0.5, 1.5)),  # cone 3.72
    "roll_sideslip": Free(0.2, 8.0, (1.0, 5.0)),  # cone 8.36
    "yaw_sideslip": Free(0.09, 1.1, (0.1, 0.4)),  # cone -0.09
    "side_sideslip": Free(0.4, 2.5, (0.6, 1.6)),  # cone 1.52
    "roll_roll_rate": Free(0.3, 3.0, (0.6, 1.8)),  # cone 1.40
    "pitch_pitch_rate": Free(0.3, 3.0, (0.7, 2.8)),  # cone 0.25
    "yaw_yaw_rate": Free(0.3, 3.0, (0.5, 1.8)),  # cone 8.31
    "yaw_roll_rate": _signed(0.0, 2.0, (0.2, 1.5)),  # cone 5.62
    "lift_basic": Free(0.3, 1.2, (0.32, 0.45)),  # cone 1.33
    "lift_offset": _signed(-0.005, 0.025, (0.012, 0.016)),  # CL
    "pitch_offset": _signed(-0.0015, 0.0015, (-0.0003, 0.0003)),  # Cm
    "pitch_slope": _signed(-0.0006, 0.0003, (-0.0002, 0.00005)),  # Cm per deg
    "drag_offset": _signed(-0.025, 0.01, (-0.017, -0.01)),  # CD
    "drag_rise": Free(
        0.0003, 0.008, (0.0018, 0.004)
    ),  # CD per deg2 about 3 deg, with the difference's sign
    "cowl_area": Free(0.4, 1.4, (0.65, 0.95)),
    "thrust_arm": _signed(-1.0, 2.0, (0.5, 1.3)),
    "length": _signed(45.0, 59.0, (51.0, 55.0)),  # of the S, s
    "bank_time": Free(0.7, 4.0, (1.2, 2.5)),  # s
    "sharpness": Free(1.0, 3.0, (1.4, 2.4)),
}
_INERTIAS = {f"inertia_{axes}": f"inertia_{axes}" for axes in ("xx", "yy", "zz")}
_INERTIAS["inertia_matrix_element_13"] = "inertia_13"
MISSION = ("length", "bank_time", "sharpness")

BASE = load_vehicle(ROOT / "configs/vehicle/ghame_x.yaml")
BASE_MISSION = read_mission(ROOT / "configs/mission/s_manoeuvre.yaml")


def first_mean(generator: np.random.Generator) -> dict[str, float]:
    """A search's first mean, drawn anew for each seed."""
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
    """Values as numbers of the search, whose unit is a third of the first range."""
    return np.array(
        [(_scaled(f, values[n]) - _scaled_middle(f)) / _unit(f) for n, f in FREE.items()]
    )


def to_values(numbers: Floats) -> dict[str, float]:
    """Values inside the box."""
    values = {}
    for (name, free), number in zip(FREE.items(), numbers, strict=True):
        x = _scaled_middle(free) + _unit(free) * float(number)
        values[name] = float(np.clip(np.exp(x) if free.logarithmic else x, free.low, free.high))
    return values


def limits() -> tuple[Floats, Floats]:
    """The box in numbers of the search."""
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
    """The packed row of a table or an inertia."""
    if name in _INERTIAS:
        return int(BASE.tables.fixed_row[FIXED_TABLE_ROWS.index(_INERTIAS[name])])
    wanted = COEFFICIENTS.index(TABLES[name][0]), VARIABLES.index(TABLES[name][1])
    terms = zip(BASE.build_up.coefficient, BASE.build_up.table, BASE.build_up.variable, strict=True)
    return next(
        int(row) for coefficient, row, variable in terms if (coefficient, variable) == wanted
    )


def _axes_of(row: int) -> tuple[int, list[int], list[tuple[str, Floats]]]:
    """Where a row's first node lies in the packed data, the strides and the axes (variable, nodes)."""
    tables = BASE.tables
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
    """Where a table's nodes lie in the packed data, [axis...], and their angle of attack, deg (zero without one)."""
    first, strides, axes = _axes_of(_row_of(name))
    node = np.indices([nodes.size for _, nodes in axes])
    cells = first + sum(stride * i for stride, i in zip(strides, node, strict=True))
    alpha = np.zeros(node[0].shape)
    for i, (variable, nodes) in zip(node, axes, strict=True):
        if variable == "angle_of_attack":
            alpha = np.rad2deg(nodes[i])
    return cells, alpha


def grids_of(name: str) -> list[Floats]:
    """The nodes of a table's axes: Mach, angle of attack (rad)."""
    return [nodes for _, nodes in _axes_of(_row_of(name))[2]]


_CELLS = {name: _cells_of(name) for name in (*TABLES, *_INERTIAS)}
_ROWS = table_rows(BASE.tables, make_variables(BASE, mach=MACH, angle_of_attack=np.deg2rad(ALPHA)))


def _at_s(name: str) -> float:
    """GHAME's coefficient in the S, per rad."""
    return float(_ROWS[_row_of(name), 0])


_RUDDER_ROLL = _at_s("roll_rudder") / _at_s("roll_aileron")
_RUDDER_YAW = abs(_at_s("yaw_rudder") / _at_s("yaw_sideslip"))


def factors_of(values: dict[str, float]) -> dict[str, float]:
    """Factors on GHAME's tables and inertias; the inertias kept to a rigid body at both mass points."""
    factors = {name: values.get(name, 1.0) for name in _CELLS}
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
    """The nodes of every table and inertia that the vehicle changes, per rad."""
    nodes = {}
    for name, factor in factors_of(values).items():
        cells, alpha = _CELLS[name]
        nodes[name] = factor * BASE.tables.data[cells]
        if name == "lift_basic":
            nodes[name] += values["lift_offset"]
        elif name == "pitch_basic":
            nodes[name] += values["pitch_offset"] + values["pitch_slope"] * (alpha - 3.0)
        elif name == "drag_basic":
            nodes[name] += values["drag_offset"] + values["drag_rise"] * (alpha - 3.0) * np.abs(
                alpha - 3.0
            )
    return nodes


def make_vehicle(values: dict[str, float]) -> Vehicle:
    """The vehicle in memory."""
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
    """The S, to the right first."""
    s = BASE_MISSION.manoeuvre.model_copy(
        update={"offset": -5000.0} | {name: values[name] for name in MISSION}
    )
    return BASE_MISSION.model_copy(update={"manoeuvre": s})
