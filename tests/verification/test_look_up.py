"""The compiled look-up of tables against scipy and against plain numpy, inside, on the nodes and outside."""

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from verification.shown import check

from abhv_mc.array_types import Floats
from abhv_mc.jit import kernel
from abhv_mc.plant import state as s
from abhv_mc.plant.aerodynamics import look_up, make_cells
from abhv_mc.shipped import shipped_configs
from abhv_mc.user_code.vehicle_functions import load_vehicle
from abhv_mc.vehicle.arrays import VARIABLES, Tables
from abhv_mc.vehicle.evaluate import evaluate_tables
from abhv_mc.verification.rows import Row

POINTS = 4000


@kernel
def look_up_points(tables: Any, cells: Any, variables: Any, rows: Any) -> None:
    """Table rows ``[row, point]`` of variables ``[variable, point]``, 16 abreast as in flight."""
    Z = np.zeros((s.LAW, 16))
    T = np.zeros((s.MAX_TABLE_ROWS, 16))
    for first in range(0, variables.shape[1], 16):
        for i in range(variables.shape[0]):
            for lane in range(16):
                Z[s.VAR + i, lane] = variables[i, first + lane]
        look_up(Z, T, 16, tables, cells)
        for i in range(rows.shape[0]):
            for lane in range(16):
                rows[i, first + lane] = T[i, lane]


def draw_points(tables: Tables, where: str) -> Floats:
    """Variables ``[variable, point]``: ``inside`` the grids, on their ``nodes``, or up to half a range ``outside``."""
    generator = np.random.default_rng(["inside", "nodes", "outside"].index(where))
    variables = np.zeros((len(VARIABLES), POINTS))
    variables[0] = 1.0
    for variable in np.unique(tables.axis_variable):
        if variable == 0:
            continue
        grids = [_grid(tables, int(axis)) for axis in np.flatnonzero(tables.axis_variable == variable)]
        nodes = np.unique(np.concatenate(grids))
        low, high = nodes[0], nodes[-1]
        if where == "nodes":
            variables[variable] = generator.choice(nodes, POINTS)
        else:
            margin = 0.5 * (high - low) if where == "outside" else 0.0
            variables[variable] = generator.uniform(low - margin, high + margin, POINTS)
    return variables


def _grid(tables: Tables, axis: int) -> Floats:
    first = tables.axis_start[axis]
    return tables.grid[first : first + tables.axis_length[axis]]


def evaluate_by_scipy(tables: Tables, variables: Floats) -> Floats:
    """Table rows ``[row, point]`` by RegularGridInterpolator, points clipped to each grid."""
    rows = np.zeros((tables.n_rows, variables.shape[1]))
    for g in range(tables.group_start.size):
        axes = [d for d in range(3) if tables.group_stride[g, d] > 0]
        grids = [_grid(tables, int(tables.group_axis[g, d])) for d in axes]
        width, row, start = (int(of[g]) for of in (tables.group_width, tables.group_row, tables.group_start))
        nodes = sum(
            np.arange(grid.size).reshape([-1 if i == j else 1 for j in range(len(axes))]) * tables.group_stride[g, d]
            for i, (d, grid) in enumerate(zip(axes, grids, strict=True))
        )
        values = tables.data[start + np.asarray(nodes)[..., np.newaxis] + np.arange(width)]
        names = [tables.axis_variable[tables.group_axis[g, d]] for d in axes]
        points = [np.clip(variables[name], grid[0], grid[-1]) for name, grid in zip(names, grids, strict=True)]
        rows[row : row + width] = RegularGridInterpolator(grids, values)(np.stack(points, axis=-1)).T
    return rows


@pytest.mark.parametrize("name", ["ghame", "winged_cone"])
def test_look_up(name: str) -> None:
    """Differences relative to each table's largest value there."""
    rows = []
    tables = load_vehicle(shipped_configs() / "vehicle" / f"{name}.yaml").tables
    for where in ("inside", "nodes", "outside"):
        variables = draw_points(tables, where)
        compiled = np.empty((tables.n_rows, POINTS))
        look_up_points(tables, make_cells(16), variables, compiled)
        for other, evaluate in (("scipy", evaluate_by_scipy), ("numpy", evaluate_tables)):
            expected = evaluate(tables, variables)
            scale = np.maximum(np.abs(expected).max(axis=1, keepdims=True), 1e-300)
            worst = float((np.abs(compiled - expected) / scale).max())
            rows.append(Row(f"tables of {name}", other, f"random points, {where}", "relative", worst, 1e-13))
    check(rows)
