"""What a group of lanes works in besides its flights' inputs and results, allocated once a call."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.kernel.flight import observe
from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.laws.trim_lookup import TrimCells, make_trim_cells
from abhv_mc.kernel.laws.user import MEMORY, ONBOARD
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.aerodynamics import TableCells, make_cells
from abhv_mc.kernel.plant.effectors import A_ROWS
from abhv_mc.kernel.plant.state import aligned_zeros

TOGETHER = 256  # flights that share a compaction: what is saved of them stays in a near cache

Z_ROWS = observe.END_ROW  # the observer's rows are the last
O_ROWS = observe.N_ROWS
SAVED_ROWS = Z_ROWS + O_ROWS + A_ROWS


class Memory(NamedTuple):
    """Working memory of the lanes, and the saved lanes of flights that wait for their turn."""

    Z: Floats  # [row, lane] state, parameters, air data, ... see abhv_mc.kernel.plant.state
    O: Floats  # [row, lane] end of the flight and metrics, see abhv_mc.kernel.flight.observe
    A: Floats  # [row, lane] effectors with actuators of their own, see abhv_mc.kernel.plant.effectors
    E: Floats  # [2 channel + side, lane] extremes of a bin, see abhv_mc.kernel.flight.observe
    T: Floats  # [table row, lane]
    cells: TableCells
    trim: TrimCells
    high: Floats  # [table row], for slopes
    saved: Floats  # [flight, row] rows of Z and O of waiting flights
    order: Ints  # [flight] their numbers


def make_memory(width: int) -> Memory:
    """Memory of ``width`` lanes for any vehicle."""
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
    """Whether the memory is that of ``width`` lanes. Machine code that has asked knows how far apart rows lie."""
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
    """Save everything that a flight carries from tick to tick, to ``row`` [SAVED_ROWS].

    ``driven``: effectors with actuators of their own are part of it; ``custom``: functions of the vehicle; ``own``: the
    memory of a user's law.
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
    """Flights from ``saved`` [flight, SAVED_ROWS] back into the lanes; spare lanes repeat the last."""
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
