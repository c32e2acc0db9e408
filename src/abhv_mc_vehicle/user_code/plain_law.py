"""Control laws in plain Python for prototypes, called like compiled laws.

A plain law may use any library, and any object as its memory.
"""

import ctypes
import sys
import traceback
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.laws.user import FAULT, MEMORY, N_ONBOARD, ONBOARD
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.user_code.compiled import (
    COMMAND_ROWS,
    LAW_FAILED,
    ONBOARD_ROWS,
    make_gains_class,
    split_columns,
)
from abhv_mc_vehicle.user_code.law_interface import (
    NOT_GIVEN,
    Command,
    Measured,
    Onboard,
    Reference,
    nest,
)
from abhv_mc_vehicle.user_code.module import Law, describe_exception, find_line
from abhv_mc_vehicle.user_code.unpack import in_its_folder, watching

SOCKET = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, *4 * [ctypes.POINTER(ctypes.c_double)], ctypes.c_int64, ctypes.c_double
)
# line and description of the last exception of each law, by the hash of its source
failures: dict[str, tuple[int | None, str]] = {}


class PlainLaw:
    """Adapter that calls a control law in Python from compiled code.

    ``address`` is valid as long as the adapter exists. The law's memory may be any object and is
    stored in the adapter. With ``memory_in_rows``, it is a named tuple of numbers that is stored in
    rows of lane memory.
    """

    def __init__(
        self,
        law: Law,
        gains: tuple[str, ...],
        width: int,
        memory_in_rows: bool = False,
        effectors: tuple[str, ...] = (),
    ) -> None:
        self._in_rows = memory_in_rows
        self._remembers = "memory" in law.arguments
        self._law = law
        self._width = width
        self._effectors = {name: s.EFFECTOR_COMMAND + i for i, name in enumerate(effectors)}
        self._gains, self._commands = split_columns(gains)
        self._memories: dict[
            int, Any
        ] = {}  # memories of the flights, by the index stored in each lane
        self._callback = SOCKET(self._call)

    @property
    def address(self) -> int:
        """Address of the function that compiled code calls."""
        return int(ctypes.cast(self._callback, ctypes.c_void_p).value or 0)

    def _call(
        self, context: Any, Z: Any, reference: Any, gains: Any, settings: Any, tick: int, dt: float
    ) -> None:
        block = np.ctypeslib.as_array(Z, (ONBOARD + N_ONBOARD, self._width))
        law = self._law
        columns = _row(gains, tick, len(self._gains) + len(self._commands))
        designed = len(self._gains)
        shared_values = {
            "time": tick * dt,
            "dt": dt,
            "reference": Reference(*_row(reference, tick, len(REFERENCE))),
            "gains": make_gains_class(self._gains)(*columns[:designed]),
            "commands": self._commands and law.commands(*columns[designed:]),
            "settings": law.settings and law.settings(*settings[: len(law.settings._fields)]),
        }
        for lane in range(self._width):
            if block[FAULT, lane] > 0.0:
                continue
            if self._in_rows:
                lane_memory = None
                if self._remembers and tick > 0:
                    rows = slice(MEMORY, MEMORY + len(law.memory._fields))
                    lane_memory = law.memory(*block[rows, lane].tolist())
                self._try_lane(block, lane, lane_memory, shared_values)
                continue
            if tick == 0:
                block[MEMORY, lane] = len(self._memories)
                self._memories[len(self._memories)] = None
            number = int(block[MEMORY, lane])
            self._memories[number] = self._try_lane(
                block, lane, self._memories[number], shared_values
            )

    def _try_lane(
        self, block: Floats, lane: int, memory: Any, shared_values: dict[str, Any]
    ) -> Any:
        """Run the law for one flight and tick, and return the flight's new memory.

        An exception ends the flight; its traceback is printed once per law.
        """
        try:
            if shared_values["time"] == 0.0 and self._remembers:
                memory = self._law.memory()
            with in_its_folder(self._law.source), watching(self._law.source):
                return self._fly_lane(block, lane, memory, shared_values)
        except BaseException as error:
            # Also catch SystemExit, because the compiled caller would otherwise continue the
            # flight.
            block[FAULT, lane] = LAW_FAILED
            block[list(COMMAND_ROWS), lane] = 0.0
            source = self._law.source
            if source.hash not in failures:
                traceback.print_exc(file=sys.stderr)
            failures[source.hash] = find_line(error, source.file), describe_exception(error)
            return memory

    def _fly_lane(
        self, block: Floats, lane: int, memory: Any, shared_values: dict[str, Any]
    ) -> Any:
        law = self._law
        values = {**shared_values, "memory": memory}
        if "measured" in law.arguments:
            values["measured"] = Measured(*block[s.MEASURED : s.MEASURED + s.N_SEEN, lane].tolist())
        if "onboard" in law.arguments:
            values["onboard"] = nest(Onboard, iter(block[list(ONBOARD_ROWS), lane].tolist()))
        returned = law.function(*(values[name] for name in law.arguments))
        pair = returned if self._remembers else (returned, None)
        if type(pair) is not tuple or len(pair) != 2 or not isinstance(pair[0], Command):
            expected = f"Command(...){', memory' if self._remembers else ''}"
            raise TypeError(f"the law returned {type(returned).__name__}, not {expected}")
        command, memory = pair
        engine = command.equivalence_ratio if command.throttle == NOT_GIVEN else command.throttle
        block[list(COMMAND_ROWS), lane] = (*command[:3], engine, *command[4:7])
        for name, value in dict(command.effectors).items():
            block[self._effectors[name], lane] = value
        if self._in_rows and self._remembers:
            block[MEMORY : MEMORY + len(memory), lane] = memory
        return memory


def _row(pointer: Any, tick: int, columns: int) -> list[float]:
    return pointer[tick * columns : (tick + 1) * columns]
