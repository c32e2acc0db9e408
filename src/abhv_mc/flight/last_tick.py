"""Where a flight was that ended its process: its tick and what it measured, in a file that outlives the process.

A flight that is flown alone in a process that may be lost has its lanes' memory there.
"""

import contextlib
import mmap
import os
import threading
from collections.abc import Iterator

import numpy as np

from abhv_mc.kernel.flight import observe
from abhv_mc.kernel.flight.interface import LANES
from abhv_mc.kernel.flight.memory import O_ROWS, Z_ROWS, Memory, make_memory
from abhv_mc.kernel.plant import state as s
from abhv_mc.user_code.child import may_run_here
from abhv_mc.user_code.law_interface import Measured, find_unit
from abhv_mc.user_code.unpack import laws_folder

_ROWS = Z_ROWS + O_ROWS + 1  # the last holds the control period


@contextlib.contextmanager
def open_memory(width: int, flights: int, tick_length: float) -> Iterator[Memory]:
    """Memory of ``width`` lanes for any vehicle; for one flight, in a process that may be lost, shared by a file."""
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
    """Where the lone flight of a process that was lost was, as the end of a sentence; empty where there was none."""
    words = ""
    for path in laws_folder().glob(f"flying_{process}_*"):
        content = path.read_bytes()
        path.unlink()
        if len(content) != 8 * _ROWS * LANES:  # of a process that was lost before it flew
            continue
        lane = np.frombuffer(content).reshape(_ROWS, LANES)[:, 0]
        tick = int(lane[Z_ROWS + observe.SAMPLES])
        names = Measured._fields[: s.N_MEASURED]
        values = lane[s.MEASURED : s.MEASURED + s.N_MEASURED].tolist()
        measured = [f"{name} {v:.9g} {find_unit(f'measured.{name}')}" for name, v in zip(names, values, strict=True)]
        words = f", at {tick * lane[-1]:g} s (tick {tick}), measured: {', '.join(measured)}"
    return words
