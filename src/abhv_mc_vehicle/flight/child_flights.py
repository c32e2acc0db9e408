"""Simulation of flights with native control laws in a child process that may crash.

The memory of a single flight is mapped to a file that remains after a crash, so that the last tick
can be reported.
"""

import contextlib
import mmap
import os
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.child import LostError, in_child, may_run_here
from abhv_mc.flights.blocks import FlightBlock, Recording, join_blocks, make_failed_block
from abhv_mc_vehicle.flight.arguments import SavedFlights
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.kernel.flight import observe
from abhv_mc_vehicle.kernel.flight.interface import LANES
from abhv_mc_vehicle.kernel.flight.memory import O_ROWS, Z_ROWS, Memory, make_memory
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.user_code.law_interface import Measured, find_unit
from abhv_mc_vehicle.user_code.unpack import laws_folder

_LIMIT = 60.0  # time limit for each group of up to 16 flights, s
_FEW = 16
_ROWS = Z_ROWS + O_ROWS + 1  # number of rows of the file; the last row contains the control period
_compiled: set[int] = set()  # lane counts for which the child has loaded compiled flights


def fly_in_child(
    fly: Callable[..., FlightBlock],
    plan: FlightPlan,
    parameters: Floats,
    recording: Recording,
    lanes: int,
    *,
    keep_states: bool,
    start: SavedFlights | None = None,
) -> FlightBlock:
    """Call ``fly`` in the child process.

    If a single flight crashes the process or exceeds the time limit twice, its outcome states this.
    """
    if lanes not in _compiled:  # Compilation does not count towards the time limit.
        in_child(fly, plan, parameters[:0], recording, lanes, keep_states)
        _compiled.add(lanes)

    def attempt(rows: Floats) -> FlightBlock:
        limit = _LIMIT * max(1, -(-len(rows) // _FEW))
        return in_child(fly, plan, rows, recording, lanes, keep_states, start, limit=limit)

    try:
        return attempt(parameters)
    except LostError:
        if start is not None:
            raise
        if len(parameters) > 1:
            rows = (row[None] for row in parameters)
            return join_blocks(
                [
                    fly_in_child(fly, plan, row, recording, lanes, keep_states=keep_states)
                    for row in rows
                ]
            )
    try:
        return attempt(parameters)
    except LostError as error:
        reason = f"{error.words}{describe_last_tick(error.process)}"
        print(
            f"controller '{plan.controller}': the control law failed in a flight: {reason}",
            file=sys.stderr,
            flush=True,
        )
        outcome = plan.lost_outcome(error.hung)
        states = s.N_STATES if keep_states else 0
        block = make_failed_block(plan, outcome, recording, len(plan.metrics), states)
        return replace(block, reasons={0: reason})


@contextlib.contextmanager
def open_memory(width: int, flights: int, tick_length: float) -> Iterator[Memory]:
    """Yield memory for ``width`` lanes that is large enough for any vehicle.

    For a single flight in a process that may crash, the memory is mapped to a file.
    """
    if flights != 1 or width != LANES or not may_run_here():
        yield make_memory(width)
        return
    path = laws_folder() / f"flying_{os.getpid()}_{threading.get_native_id()}"
    with path.open("w+b") as file:
        file.truncate(8 * _ROWS * width)
        block = np.frombuffer(mmap.mmap(file.fileno(), 0)).reshape(_ROWS, width)
    block[-1] = tick_length
    try:
        yield make_memory(width)._replace(Z=block[:Z_ROWS], O=block[Z_ROWS:-1])
    finally:
        path.unlink(missing_ok=True)


def describe_last_tick(process: int | None) -> str:
    """Return a clause that names the last tick of a flight in a crashed process, or ''."""
    description = ""
    for path in laws_folder().glob(f"flying_{process}_*"):
        content = path.read_bytes()
        path.unlink()
        if len(content) != 8 * _ROWS * LANES:  # The process ended before the first tick.
            continue
        lane = np.frombuffer(content).reshape(_ROWS, LANES)[:, 0]
        tick = int(lane[Z_ROWS + observe.SAMPLES])
        names = Measured._fields[: s.N_MEASURED]
        values = lane[s.MEASURED : s.MEASURED + s.N_MEASURED].tolist()
        measured = [
            f"{name} {v:.9g} {find_unit(f'measured.{name}')}"
            for name, v in zip(names, values, strict=True)
        ]
        description = (
            f"; the last tick was {tick}, at {tick * lane[-1]:g} s, with the measurements "
            f"{', '.join(measured)}"
        )
    return description
