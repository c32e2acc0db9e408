"""What a group of lanes needs besides its flights' inputs and results, allocated once a call."""

from typing import NamedTuple

import numpy as np

from abhv_mc.control import tlc
from abhv_mc.control.trim_lookup import TrimCells, make_trim_cells
from abhv_mc.flight import observe
from abhv_mc.jit import lanes
from abhv_mc.numerics.lane_memory import aligned_zeros
from abhv_mc.plant import state as s
from abhv_mc.plant.aerodynamics import Cells, make_cells
from abhv_mc.vehicle.arrays import Floats, Ints

TOGETHER = 256  # flights that close ranks: what they remember stays near the processor

Z_ROWS = s.LAW + tlc.N_ROWS
KEPT_ROWS = Z_ROWS + observe.N_ROWS


class Memory(NamedTuple):
    """Room of the lanes at work and of the flights that wait."""

    Z: Floats  # [row, lane] state, parameters, air data, ...
    O: Floats  # [row, lane] what is observed
    T: Floats  # [table row, lane]
    cells: Cells
    trim: TrimCells
    high: Floats  # [table row], for slopes
    unit_factors: Ints  # [term] the parameter that is 1, for the nominal vehicle
    kept: Floats  # [flight, row] what waiting flights remember
    order: Ints  # [flight] their numbers


def make_memory(width: int, terms: int) -> Memory:
    """Memory of ``width`` lanes for a vehicle with ``terms`` terms in its build-up."""
    return Memory(
        aligned_zeros((Z_ROWS, width)),
        aligned_zeros((observe.N_ROWS, width)),
        aligned_zeros((s.MAX_TABLE_ROWS, width)),
        make_cells(width),
        make_trim_cells(width),
        aligned_zeros(s.MAX_TABLE_ROWS),
        np.zeros(terms, np.int64),
        aligned_zeros((TOGETHER, KEPT_ROWS)),
        np.zeros(TOGETHER, np.int64),
    )


@lanes
def has_width(memory, width):
    """Whether the memory is that of ``width`` lanes. Machine code that has asked knows how far apart rows lie."""
    return (
        memory.Z.shape[1] == width
        and memory.O.shape[1] == width
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
