"""A law in plain Python called like a compiled one: for prototypes, with any library and any object as its memory."""

import ctypes
import sys
import traceback
from typing import Any

import numpy as np

from abhv_mc.control.columns import REFERENCE
from abhv_mc.control.laws.own import FAULT, MEMORY, N_ONBOARD, ONBOARD
from abhv_mc.own.compiled import COMMAND_ROWS, make_gains_class
from abhv_mc.own.source import Law
from abhv_mc.own.wires import Command, Measured, Onboard, Reference
from abhv_mc.plant import state as s
from abhv_mc.vehicle.arrays import Floats

LAW_FAILED = 50.0  # abhv_mc.flight.outcome.Outcome.LAW_FAILED, which is a layer above

_SOCKET = ctypes.CFUNCTYPE(None, *4 * [ctypes.POINTER(ctypes.c_double)], ctypes.c_int64, ctypes.c_double)
_told: set[str] = set()  # laws whose traceback was printed


class PlainLaw:
    """Calls a law for one flight after another; the ``address`` holds as long as this object lives."""

    def __init__(self, law: Law, gains: tuple[str, ...], width: int) -> None:
        self._law, self._gains, self._width = law, make_gains_class(gains) if gains else None, width
        self._memories: dict[int, Any] = {}  # by a number that the flight's lane holds
        self._callback = _SOCKET(self._call)

    @property
    def address(self) -> int:
        """Where compiled code finds it."""
        return int(ctypes.cast(self._callback, ctypes.c_void_p).value or 0)

    def _call(self, Z: Any, reference: Any, gains: Any, settings: Any, tick: int, dt: float) -> None:
        block = np.ctypeslib.as_array(Z, (ONBOARD + N_ONBOARD, self._width))
        law = self._law
        given: dict[str, Any] = {"time": tick * dt, "dt": dt}
        given["reference"] = Reference(*_row(reference, tick, len(REFERENCE)))
        if self._gains is not None:
            given["gains"] = self._gains(*_row(gains, tick, len(self._gains._fields)))
        if law.settings is not None:
            given["settings"] = law.settings(*settings[: len(law.settings._fields)])
        first_of: dict[int, int] = {}
        for lane in range(self._width):
            if block[FAULT, lane] > 0.0:
                continue
            if tick == 0:
                block[MEMORY, lane] = len(self._memories)
                self._memories[len(self._memories)] = law.memory() if "memory" in law.arguments else None
            number = int(block[MEMORY, lane])
            if number in first_of:  # a spare lane that repeats a flight
                block[list(COMMAND_ROWS), lane] = block[list(COMMAND_ROWS), first_of[number]]
                block[FAULT, lane] = block[FAULT, first_of[number]]
                continue
            first_of[number] = lane
            try:
                self._fly_lane(block, lane, number, given)
            except Exception:
                block[FAULT, lane] = LAW_FAILED
                block[list(COMMAND_ROWS), lane] = 0.0
                if law.source.hash not in _told:
                    _told.add(law.source.hash)
                    traceback.print_exc(file=sys.stderr)

    def _fly_lane(self, block: Floats, lane: int, number: int, given: dict[str, Any]) -> None:
        law = self._law
        values = {**given, "memory": self._memories[number]}
        if "measured" in law.arguments:
            values["measured"] = Measured(*block[s.MEASURED : s.MEASURED + s.N_MEASURED, lane].tolist())
        if "onboard" in law.arguments:
            numbers = block[ONBOARD : ONBOARD + N_ONBOARD, lane].tolist() + block[s.CMD : s.CMD + 4, lane].tolist()
            values["onboard"] = _nest(Onboard, iter(numbers))
        returned = law.function(*(values[name] for name in law.arguments))
        if "memory" in law.arguments:
            command, self._memories[number] = returned
        else:
            command = returned
        if not isinstance(command, Command):
            raise TypeError(f"the law returns {type(command).__name__}; wanted Command(...)")
        block[list(COMMAND_ROWS), lane] = command


def _row(pointer: Any, tick: int, columns: int) -> list[float]:
    return pointer[tick * columns : (tick + 1) * columns]


def _nest(kind: Any, numbers: Any) -> Any:
    """A named tuple from its numbers, however deep."""
    hints = kind.__annotations__.values()
    return kind(*(_nest(hint, numbers) if hasattr(hint, "_fields") else next(numbers) for hint in hints))
