"""Working memory of a group of lanes, allocated once per call."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc_vehicle.kernel.flight import observe
from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.laws.trim_lookup import TrimCells, make_trim_cells
from abhv_mc_vehicle.kernel.laws.user import FAULT, MEMORY, ONBOARD
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.aerodynamics import TableCells, make_cells
from abhv_mc_vehicle.kernel.plant.effectors import A_ROWS
from abhv_mc_vehicle.kernel.plant.state import aligned_zeros

TOGETHER = 256  # number of flights whose saved memory fits into the processor's cache

Z_ROWS = observe.END_ROW  # number of rows of Z
O_ROWS = observe.N_ROWS
SAVED_ROWS = Z_ROWS + O_ROWS + A_ROWS


class Memory(NamedTuple):
    """Working memory of the lanes, and saved memory of flights that wait for a lane."""

    Z: Floats  # [row, lane] state, parameters, air data, ... see abhv_mc_vehicle.kernel.plant.state
    # [row, lane] end of the flight and metrics, see abhv_mc_vehicle.kernel.flight.observe
    O: Floats
    A: Floats  # [row, lane] effectors with actuators, see abhv_mc_vehicle.kernel.plant.effectors
    # [2 channel + side, lane] extremes of a bin, see abhv_mc_vehicle.kernel.flight.observe
    E: Floats
    T: Floats  # table values [table row, lane]
    cells: TableCells
    trim: TrimCells
    high: Floats  # [table row] buffer for slopes
    saved: Floats  # [flight, row] rows of Z and O of waiting flights
    order: Ints  # [flight] numbers of the waiting flights


def make_memory(width: int) -> Memory:
    """Return working memory for ``width`` lanes, large enough for any vehicle."""
    return Memory(
        aligned_zeros((Z_ROWS, width)),
        aligned_zeros((O_ROWS, width)),
        aligned_zeros((A_ROWS, width)),
        aligned_zeros((observe.E_ROWS, width)),
        aligned_zeros((s.MAX_TABLE_ROWS, width)),
        make_cells(width),
        make_trim_cells(width),
        aligned_zeros(s.MAX_TABLE_ROWS),
        aligned_zeros((TOGETHER, SAVED_ROWS)),
        np.zeros(TOGETHER, np.int64),
    )


@lanes
def has_width(memory, width):
    """Return whether the memory has ``width`` lanes, to tell the compiler the row stride."""
    return (
        memory.Z.shape[1] == width
        and memory.O.shape[1] == width
        and memory.A.shape[1] == width
        and memory.E.shape[1] == width
        and memory.T.shape[1] == width
        and memory.cells.cell.shape[1] == width
        and memory.cells.fraction.shape[1] == width
        and memory.cells.weight.shape[1] == width
        and memory.trim.cell.shape[1] == width
        and memory.trim.low.shape[1] == width
        and memory.trim.high.shape[1] == width
        and memory.trim.per_step.shape[1] == width
        and memory.trim.fraction.shape[1] == width
    )


@lanes
def save_lane(memory, lane, row, driven, custom, own):
    """Save the memory of the flight in a lane to ``row`` [SAVED_ROWS].

    The saved memory includes effectors with actuators if ``driven``, rows of custom functions if
    ``custom``, and the memory of a custom control law if ``own``.
    """
    for i in range(s.CUSTOM_STATE if not custom else s.LAW):
        row[i] = memory.Z[i, lane]
    for i in range(s.LAW, MEMORY if not own else ONBOARD):
        row[i] = memory.Z[i, lane]
    for i in range(ONBOARD, Z_ROWS):
        row[i] = memory.Z[i, lane]
    for i in range(O_ROWS):
        row[Z_ROWS + i] = memory.O[i, lane]
    if driven:
        for i in range(A_ROWS):
            row[Z_ROWS + O_ROWS + i] = memory.A[i, lane]


@lanes
def restore_lanes(memory, width, saved, first, n, driven, custom, own):
    """Restore flights from ``saved`` [flight, SAVED_ROWS]; see :func:`end_spare_lanes`."""
    for lane in range(width):
        row = saved[first + min(lane, n - 1)]
        for i in range(s.CUSTOM_STATE if not custom else s.LAW):
            memory.Z[i, lane] = row[i]
        for i in range(s.LAW, MEMORY if not own else ONBOARD):
            memory.Z[i, lane] = row[i]
        for i in range(ONBOARD, Z_ROWS):
            memory.Z[i, lane] = row[i]
        for i in range(O_ROWS):
            memory.O[i, lane] = row[Z_ROWS + i]
        if driven:
            for i in range(A_ROWS):
                memory.A[i, lane] = row[Z_ROWS + O_ROWS + i]
    end_spare_lanes(memory, width, n)


@lanes
def end_spare_lanes(memory, width, n):
    """Mark the lanes from ``n`` as ended; they repeat a flight, but no law is called for them."""
    for lane in range(n, width):
        memory.O[observe.ALIVE, lane] = 0.0
        memory.Z[FAULT, lane] = 1.0
