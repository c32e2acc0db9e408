"""Nominal controls along a trajectory (Zhu and Shen 2014, eq. 12), by nested searches.

The paper solves its three equations in turn. This method diverges beyond 45 deg of bank, because
each pass multiplies the error by ``-tan^2 bank``. This module solves the first equation in an outer
search. For each trial value, the second equation is solved for the angle of attack; the third
equation gives the bank explicitly.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.io.phrases import counted, grouped_digits
from abhv_mc_vehicle.kernel.laws.trim_lookup import TRIM_ROWS
from abhv_mc_vehicle.kernel.laws.trim_search import (
    BANK_LIMIT,
    NO_ANGLE_OF_ATTACK,
    NO_BANK,
    NO_ELEVATOR,
    NO_EQUIVALENCE_RATIO,
    Cut,
    GuidancePoints,
    SearchBounds,
    fill_trim,
)
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc_vehicle.vehicle.effectors import deflection_range


class GuidanceTrim(NamedTuple):
    """Nominal controls along a trajectory, each of shape ``[point]``."""

    angle_of_attack: Floats
    bank: Floats
    equivalence_ratio: Floats
    elevator: Floats
    mass: Floats  # mass at the point, after subtracting the fuel burnt before it
    # sum of flags, such as NO_EQUIVALENCE_RATIO, for controls at a limit; 0 if no flag is set
    status: NDArray[np.int64]


def trim_along(
    vehicle: Vehicle,
    trim_tables: Tables,
    points: GuidancePoints,
    mass: float,
    tick: float = 0.0,
    held_equivalence_ratio: float | None = None,
    warm_start: bool = True,
) -> GuidanceTrim:
    """Solve equation (12) at each point in order, starting each search at the last solution.

    ``mass`` is the mass at the first point, kg; if ``tick`` (time between points, s) is given, the
    mass decreases by the fuel burnt. If the range of a control (trim tables, BANK_LIMIT, the
    elevator's limits) contains no solution, the result is the bound of the range with the smaller
    residual, and a flag is set in the status.
    """
    constants = vehicle.constants
    alpha_nodes, eta_nodes = (
        trim_tables.grid[first : first + length].copy()
        for first, length in zip(
            trim_tables.axis_start[1:3], trim_tables.axis_length[1:3], strict=True
        )
    )
    eta_range = (constants.equivalence_ratio_min, constants.equivalence_ratio_max)
    bounds = SearchBounds(
        float(alpha_nodes[0]),
        float(alpha_nodes[-1]),
        *eta_range,
        *deflection_range(vehicle, 2),
        searches=2,
    )
    points = GuidancePoints(*(np.array(x, dtype=np.float64) for x in np.broadcast_arrays(*points)))
    solution = np.empty((points.speed.size, 6))
    fixed_equivalence_ratio = -1.0 if held_equivalence_ratio is None else held_equivalence_ratio
    rows = len(TRIM_ROWS)
    line = np.empty((alpha_nodes.size, rows))
    cut = Cut(alpha_nodes, eta_nodes, np.empty((eta_nodes.size, alpha_nodes.size, rows)), line)
    fill_trim(
        trim_tables,
        constants,
        points,
        mass,
        tick,
        fixed_equivalence_ratio,
        warm_start,
        bounds,
        cut,
        solution,
    )
    alpha, bank, eta, elevator, masses, status = np.ascontiguousarray(solution.T)
    return GuidanceTrim(alpha, bank, eta, elevator, masses, status.astype(np.int64))


def trim_faults(trim: GuidanceTrim, times: Floats) -> list[str]:
    """Return a sentence for each equation that has no solution within the limits."""
    sentences = {
        NO_EQUIVALENCE_RATIO: "no throttle within the engine's limits maintains the speed",
        NO_ANGLE_OF_ATTACK: "no angle of attack in the trim tables gives the required lift",
        NO_BANK: f"no bank angle up to {np.rad2deg(BANK_LIMIT):.0f} deg gives the turn rate",
        NO_ELEVATOR: "no elevator deflection within its limits balances the pitching moment",
    }
    faults = []
    for flag, sentence in sentences.items():
        points = np.flatnonzero(trim.status & flag)
        if points.size:
            faults.append(
                f"at {grouped_digits(points.size)} of {counted(times.size, 'point')} of the "
                f"reference, from {times[points[0]]:.2f} s, {sentence}"
            )
    return faults
