"""Inputs, results and working memory of the simulation kernel, as named tuples of arrays.

The working memory of a group of lanes is allocated once per call.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Ints
from abhv_mc.flights.timing import Timing
from abhv_mc_vehicle.kernel.flight import counting, observe, sensors
from abhv_mc_vehicle.kernel.flight.counting import Counted
from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.laws.trim_lookup import TrimCells, make_trim_cells
from abhv_mc_vehicle.kernel.laws.user import FAULT, MEMORY, ONBOARD
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.aerodynamics import Effectiveness, TableCells, make_cells
from abhv_mc_vehicle.kernel.plant.effectors import A_ROWS, count_driven
from abhv_mc_vehicle.kernel.plant.state import aligned_zeros
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc_vehicle.kernel.world.earth import Earth

LANES = 32  # number of flights in a group

# kinds of control laws
TLC, LQR, RECORDED, PYTHON = range(4)


class Observed(NamedTuple):
    """Limits and recorded channels, which refer to rows of the lane memory."""

    limit_row: Ints  # [limit] row of the lane memory
    limit_outcome: Floats  # [limit] outcome if the row's value is outside the limits
    limit_low: Floats  # [limit] lower limit
    limit_high: Floats  # [limit] upper limit
    channel_row: Ints  # [channel] row of the lane memory
    channel_factor: Floats  # [channel] factor applied to the row's value


class UserCode(NamedTuple):
    """Addresses of compiled custom code, and options for its calls."""

    address: int  # address of the control law's machine code, 0 for none
    onboard: int  # 1 if the control law needs the nominal vehicle
    channels: int  # address of the code that computes custom channels, 0 for none
    # 1 if the control law may read more than ten measurements, 2 if these include accelerations
    more: int
    context: int = 0  # address of data used by the control law's machine code, 0 for none
    aerodynamics: int = 0  # addresses of the vehicle's custom functions, 0 for tables
    propulsion: int = 0
    dynamics: int = 0


class KernelPlan(NamedTuple):
    """Input data for a set of flights; read-only for the kernel."""

    law: int
    vehicle: Vehicle
    trim_tables: Tables
    effectiveness: Effectiveness
    earth: Earth
    timing: Timing
    record_every: int  # control ticks between samples, 0 for no history
    observed: Observed
    unit_factors: Ints  # [term] index of a factor that is 1, for terms of the nominal vehicle
    initial_state: Floats  # [state] initial state of the vehicle, followed by custom states
    reference: Floats  # reference [tick, column]
    gains: Floats  # gains [tick, gain]
    settings: Floats  # settings of the control law
    # [knot, column] nominal air (abhv_mc_vehicle.kernel.plant.air_data); empty for calm standard
    # air
    profile: Floats
    # [flight, parameter] parameters, followed by settings of custom functions and custom states
    parameters: Floats
    counted: Counted
    first_tick: int  # tick at which the flights start
    # [flight, row] lane memory at first_tick; empty if flights start at the mission's start
    start: Floats
    user_code: UserCode = UserCode(0, 0, 0, 0)


class KernelResults(NamedTuple):
    """Results of flights, filled by the kernel."""

    metrics: Floats  # metrics [flight, metric]
    outcome: NDArray[np.int64]  # outcome code [flight]
    end_tick: NDArray[np.int64]  # tick at the end of the flight [flight]
    history: NDArray[np.float32]  # recorded channels [flight, sample, channel]
    states: Floats  # [flight, sample, state] recorded states; empty unless requested
    # [sample, channel] extremes over all flights, from each sample to the tick before the next
    # sample. ``low`` exceeds ``high`` if no flight was simulated in this period. The arrays are
    # empty unless they are requested.
    low: Floats
    high: Floats
    saved: Floats  # [flight, row] lane memory before the last tick; empty unless requested
    samples: Floats  # [quantile, flight, tick] values of quantile metrics; NaN if not counted


TOGETHER = 256  # number of flights whose saved memory fits into the processor's cache

BLOCK = 64  # number of rows that are copied together; all lanes of them fit into a first cache

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
    saved: Floats  # [flight, row] rows of Z, O and A of waiting flights
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
def _copy(rows, begin, end, saved, column, first, flights, n, saves):
    for block in range(begin, end, BLOCK):
        for lane in range(n if saves else rows.shape[1]):
            row = saved[flights[min(lane, n - 1)] - first]
            for i in range(block, min(block + BLOCK, end)):
                if saves:
                    row[column + i] = rows[i, lane]
                else:
                    rows[i, lane] = row[column + i]


@lanes
def copy_lanes(memory, plan, saved, first, flights, n, delayed, saves):
    """Save lanes to ``saved`` [flight, SAVED_ROWS], whose first flight is ``first``, or restore.

    Lanes from ``n`` repeat the last of ``flights`` and are marked as ended. The memory of custom
    functions, settings, a custom control law, metric programs and effectors with actuators is
    copied only if the plan has them, and earlier measurements only if ``delayed`` is true.
    """
    Z = memory.Z
    code = plan.user_code
    functions = code.aerodynamics != 0 or code.propulsion != 0 or code.dynamics != 0
    unused = counting.ROWS * (counting.MAX_PROGRAMS - plan.counted.programs.statistic.size)
    end = s.SETTING if functions else s.CUSTOM_STATE
    _copy(Z, 0, end, saved, 0, first, flights, n, saves)
    if plan.parameters.shape[1] > s.N_PARAMETERS:
        _copy(Z, s.SETTING, s.LAW, saved, 0, first, flights, n, saves)
    end = ONBOARD if code.address != 0 else MEMORY
    _copy(Z, s.LAW, end, saved, 0, first, flights, n, saves)
    end = sensors.MORE_NOISE if delayed else sensors.DELAY
    _copy(Z, ONBOARD, end, saved, 0, first, flights, n, saves)
    _copy(Z, sensors.MORE_NOISE, Z_ROWS, saved, 0, first, flights, n, saves)
    _copy(memory.O, 0, O_ROWS - unused, saved, Z_ROWS, first, flights, n, saves)
    if count_driven(plan.vehicle) > 0:
        _copy(memory.A, 0, A_ROWS, saved, Z_ROWS + O_ROWS, first, flights, n, saves)
    if not saves:
        end_spare_lanes(memory, Z.shape[1], n)


@lanes
def end_spare_lanes(memory, width, n):
    """Mark the lanes from ``n`` as ended; they repeat a flight, but no law is called for them."""
    for lane in range(n, width):
        memory.O[observe.ALIVE, lane] = 0.0
        memory.Z[FAULT, lane] = 1.0
