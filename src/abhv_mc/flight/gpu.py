"""The same flight on a graphics processor: one thread a flight, in the thread's own memory.

The kernel calls :func:`abhv_mc.flight.kernel.fly_groups` one lane wide. The hardware interleaves the threads' own
memory, so what neighbouring flights read at once is contiguous. Without fused multiply-adds every operation
rounds as on the processor: by construction the same bits.
"""

import math
import threading
from functools import cache
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.control.law_file import USER_LAWS
from abhv_mc.control.laws.trim_lookup import AXES, TrimCells
from abhv_mc.flight.arguments import LAWS, KernelResults, make_kernel_plan, make_results
from abhv_mc.flight.counting import MAX_REGISTERS
from abhv_mc.flight.fly import check_parameters, make_block
from abhv_mc.flight.kernel import fly_groups
from abhv_mc.flight.memory import O_ROWS, Z_ROWS, Memory
from abhv_mc.flight.plan import FlightBlock, FlightPlan, Recording, recording_of
from abhv_mc.io.input_error import Refusal
from abhv_mc.jit_cuda import cuda, device_kernel, find_device, uncontracted
from abhv_mc.plant import state as s
from abhv_mc.plant.aerodynamics import TableCells
from abhv_mc.plant.effectors import A_ROWS
from abhv_mc.vehicle.arrays import CHUNK

THREADS = 32  # of a block: one warp, so that flights that end early free their registers soonest
CAMPAIGN_BATCH = 16_384  # flights of a campaign's block: half of what an H200 flies at once, and a GB of history
_MEMORY = 4e9  # bytes of results of one launch

_one_at_a_time = threading.Lock()


@cache
def make_flight_kernel(
    law: int, table_rows: int, axes: int, scratch_rows: int, max_registers: int | None = None
) -> Any:
    """The flight of one law as a kernel, for tables of at most these sizes: they set a thread's memory.

    It takes the plan and the results; the law is a constant of it, so that it holds the code of one law only.
    """

    def fly_one(plan, results):
        flight = cuda.grid(1)
        if flight < results.outcome.shape[0]:
            cells = TableCells(
                cuda.local.array((axes, 1), np.int64),
                cuda.local.array((axes, 1), np.float64),
                cuda.local.array(axes, np.int64),
                cuda.local.array(axes, np.int64),
                cuda.local.array((4, 1), np.float64),
                cuda.local.array(scratch_rows, np.float64),
            )
            trim_cells = TrimCells(
                cuda.local.array((AXES, 1), np.int64),
                cuda.local.array((AXES, 1), np.float64),
                cuda.local.array((AXES, 1), np.float64),
                cuda.local.array((AXES, 1), np.float64),
                cuda.local.array((AXES, 1), np.float64),
                cuda.local.array(CHUNK, np.float64),
                cuda.local.array(CHUNK, np.float64),
            )
            memory = Memory(
                cuda.local.array((Z_ROWS, 1), np.float64),
                cuda.local.array((O_ROWS, 1), np.float64),
                cuda.local.array((A_ROWS, 1), np.float64),
                cuda.local.array((1, 1), np.float64),  # threads share no extremes
                cuda.local.array((table_rows, 1), np.float64),
                cells,
                trim_cells,
                cuda.local.array(scratch_rows, np.float64),
                cuda.local.array((1, 1), np.float64),  # a thread has one flight and never compacts lanes
                cuda.local.array(1, np.int64),
            )
            for i in range(axes):
                cells.cell[i, 0] = 0
                cells.fraction[i, 0] = 0.0
                cells.lowest[i] = 0
                cells.spread[i] = 0
            for i in range(AXES):
                trim_cells.cell[i, 0] = 0
                trim_cells.low[i, 0] = 0.0
                trim_cells.high[i, 0] = 0.0
            for sample in range(results.history.shape[1]):
                for channel in range(results.history.shape[2]):
                    results.history[flight, sample, channel] = math.nan
            for sample in range(results.states.shape[1]):
                for i in range(s.N_STATES):
                    results.states[flight, sample, i] = math.nan
            fly_groups(plan, memory, results, 1, law, flight, flight + 1)

    return device_kernel(fly_one, max_registers)


def kernel_of(plan: FlightPlan, max_registers: int | None = None) -> Any:
    """The kernel that a plan needs."""
    tables, slopes = plan.vehicle.tables, plan.effectiveness
    rows = [tables.n_rows, *(slopes.slope_row + tables.group_width[slopes.slope_group])]
    scratch = int(tables.group_width.max())
    axes = int(tables.axis_start.size)
    return make_flight_kernel(LAWS[plan.law], int(max(*rows, MAX_REGISTERS)), axes, scratch, max_registers)


def to_device(value: Any) -> Any:
    """A named tuple, however deep, with its arrays on the GPU."""
    if isinstance(value, np.ndarray):
        return cuda.to_device(np.ascontiguousarray(value))
    if isinstance(value, tuple):
        return type(value)(*map(to_device, value))
    return value


def fly_on_gpu(
    plan: FlightPlan,
    parameters: Floats,
    record_every: Recording | int | None = None,
    keep_states: bool = False,
    threads: int = THREADS,
    max_registers: int | None = None,
) -> FlightBlock:
    """What :func:`abhv_mc.flight.fly.fly` does, on the GPU; results do not depend on ``threads`` (of a block).

    Threads of the host take turns. Raises Refusal where there is no GPU, ValueError for an array of the wrong
    type or shape. Of extremes nothing is recorded: they would be shared by all threads.
    """
    find_device()
    if plan.law in USER_LAWS or plan.channels_hash:
        what = "a law" if plan.law in USER_LAWS else "channels"
        found = f"'{plan.controller}' with {what} of the user, compiled for the processor only"
        raise Refusal(found, "--device cpu, or the laws and channels of the program")
    recording = recording_of(record_every)._replace(extremes=False)
    host_plan = make_kernel_plan(plan, check_parameters(parameters), recording)
    parameters = host_plan.parameters
    flights = len(parameters)
    results = make_results(plan, flights, recording, keep_states)
    bytes_per_flight = parameters[:1].nbytes + sum(array[:1].nbytes for array in results)
    piece = max(threads, int(_MEMORY // max(bytes_per_flight, 1)))
    with _one_at_a_time, uncontracted():
        kernel = kernel_of(plan, max_registers)
        fixed = to_device(host_plan._replace(parameters=parameters[:0]))
        for first in range(0, flights, piece):
            own = slice(first, min(first + piece, flights))
            host = [array[own] for array in results]
            device: Any = KernelResults(*(cuda.device_array(array.shape, array.dtype) for array in host))
            blocks = -(-len(host[0]) // threads)
            kernel[blocks, threads](fixed._replace(parameters=cuda.to_device(parameters[own])), device)
            for there, here in zip(device, host, strict=True):
                if here.size:
                    there.copy_to_host(here)
    return make_block(plan, results, recording)
