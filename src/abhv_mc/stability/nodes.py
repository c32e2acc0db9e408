"""Warnings about points that lie near a node of a table, where slopes jump."""

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.kernel.plant.vehicle import VARIABLES, Tables
from abhv_mc.stability.point_slopes import Points, ask_at
from abhv_mc.stability.probe import law_tick

_NEAR = 0.02  # of the cell's length
_DEGREES = ("angle_of_attack", "sideslip", "aileron", "rudder", "elevator")


def near_nodes(plan: FlightPlan, points: Points) -> list[str]:
    """A sentence for each variable of the first point that lies close to a node of the plant's or guidance's tables."""
    variables = ask_at(plan, points, points.path[:1], points.controls[:1], np.zeros(1, np.int64))[0].variables
    found = _near("the vehicle's tables", plan.vehicle.tables, variables[0])
    if plan.law == "tlc":
        answer = law_tick(plan, points.tick, points.measured[:1], points.memory[:1])
        found += _near("the tables at trim", plan.trim_tables, answer.guided[0])
    return list(dict.fromkeys(found))


def _near(whose: str, tables: Tables, variables: Floats) -> list[str]:
    sentences = []
    for start, length, variable in zip(tables.axis_start, tables.axis_length, tables.axis_variable, strict=True):
        name, x = VARIABLES[variable], variables[variable]
        if name == "one":
            continue
        grid = tables.grid[start : start + length]
        nearest = int(np.abs(grid - x).argmin())
        cell = min(max(int(np.searchsorted(grid, x, side="right")) - 1, 0), length - 2)
        if abs(grid[nearest] - x) < _NEAR * (grid[cell + 1] - grid[cell]):
            value, node = np.rad2deg((x, grid[nearest])) if name in _DEGREES else (x, grid[nearest])
            unit = " deg" if name in _DEGREES else ""
            sentences.append(
                f"{name} {value:.4f}{unit} lies near the node {node:.4f}{unit} of {whose}: slopes are those on its side"
            )
    return sentences
