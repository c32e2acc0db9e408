"""Control law in a program: one process for each flight, and one request for each control tick."""

import ctypes
import hashlib
import json
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.source import UserSource
from abhv_mc.external_simulators.process import LostFlightError, Process
from abhv_mc.external_simulators.user_plan import UserPlan
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import notify
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.laws.user import FAULT, MEMORY, N_ONBOARD, ONBOARD
from abhv_mc_vehicle.user_code.compiled import COMMAND_ROWS, INPUT_ROWS
from abhv_mc_vehicle.user_code.effector_commands import effector_rows, find_commanded
from abhv_mc_vehicle.user_code.law_interface import COMMAND_FIELDS, NOT_GIVEN
from abhv_mc_vehicle.user_code.module import describe_exception
from abhv_mc_vehicle.user_code.native_loop import LawBackend, OpenLaw
from abhv_mc_vehicle.user_code.plain_law import SOCKET, failures
from abhv_mc_vehicle.user_code.unpack import unpack

# Position of each input: 0 is time, followed by the reference and the rows of lane memory.
_LANE = 1 + len(REFERENCE)
_POSITIONS = {
    "time": 0,
    **{f"reference.{name}": 1 + i for i, name in enumerate(REFERENCE)},
    **{name: _LANE + row for name, row in INPUT_ROWS.items()},
}


class ProcessLaw:
    """Adapter that exchanges records with the processes of the flights in all lanes."""

    def __init__(self, source: UserSource, width: int, effectors: tuple[str, ...]) -> None:
        recipe: Any = source.recipe
        self._source, self._width = source, width
        self._inputs, self._outputs = recipe["inputs"], recipe["outputs"]
        self._positions = [_POSITIONS[name] for name in self._inputs]
        rows = dict(zip(COMMAND_FIELDS, COMMAND_ROWS, strict=True))
        rows |= zip(find_commanded(source), effector_rows(source, effectors), strict=True)
        self._rows = [rows[name] for name in self._outputs]
        self._plan = UserPlan(
            command=tuple(recipe["command"]),
            folder=str(unpack(source)),
            files=tuple((name, hashlib.sha256(data).hexdigest()) for name, data in source.files),
            time_limit=recipe["time_limit"],
            reply_size=8 * len(self._rows) * (recipe["protocol"] == "binary"),
        )
        # processes of the flights in progress, by the number stored in the lane of the flight
        self._processes: dict[float, Process] = {}
        self.callback = SOCKET(self._call)

    def close(self) -> None:
        """End all processes."""
        for process in self._processes.values():
            process.end()

    def _call(
        self,
        _context: Any,
        Z: Any,
        reference: Any,
        _gains: Any,
        _settings: Any,
        tick: int,
        dt: float,
    ) -> None:
        block = np.ctypeslib.as_array(Z, (ONBOARD + N_ONBOARD, self._width))
        shared = [tick * dt, *reference[tick * len(REFERENCE) : (tick + 1) * len(REFERENCE)]]
        table = np.vstack([np.tile(shared, (self._width, 1)).T, block])
        requests = table[self._positions].T
        if tick == 0:
            block[MEMORY] = np.arange(self._width)
        for exchange in (self._send, self._receive):
            for lane in np.flatnonzero(block[FAULT] == 0.0).tolist():
                try:
                    exchange(block[:, lane], requests[lane], tick)
                except Exception as error:
                    self._fail(block[:, lane], error)
        for number in self._processes.keys() - {*block[MEMORY, block[FAULT] == 0.0].tolist()}:
            self._processes.pop(number).end()

    def _send(self, lane: Floats, request: Floats, tick: int) -> None:
        if tick == 0:
            self._processes[lane[MEMORY]] = Process(self._plan)
        process = self._processes[lane[MEMORY]]
        if not process.is_silent(0.0):
            raise ValueError("it wrote more than one reply to a request")
        record = request.tobytes()
        if not self._plan.reply_size:
            named = dict(zip(self._inputs, request.tolist(), strict=True))
            record = f"{json.dumps(named)}\n".encode()
        process.send(record)

    def _receive(self, lane: Floats, _request: Floats, _tick: int) -> None:
        reply = self._processes[lane[MEMORY]].read(self._plan.time_limit)
        lane[list(COMMAND_ROWS)] = NOT_GIVEN
        if self._plan.reply_size:
            lane[self._rows] = np.frombuffer(reply)
        else:
            record = json.loads(reply)
            lane[self._rows] = [record[name] for name in self._outputs]

    def _fail(self, lane: Floats, error: Exception) -> None:
        """End a flight; the first reason is printed."""
        outcome = Outcome.LAW_FAILED
        if isinstance(error, LostFlightError):
            hung = self._processes[lane[MEMORY]].has_timed_out
            outcome = Outcome.LAW_HUNG if hung else Outcome.LAW_CRASHED
        lane[FAULT] = outcome
        lane[list(COMMAND_ROWS)] = 0.0
        reason = describe_exception(error)
        if self._source.hash not in failures:
            notify(f"{self._source.file}: {reason}")
        failures[self._source.hash] = None, reason


def open_process(source: UserSource, _gains: Any, width: int, *further: Any) -> OpenLaw:
    """Open the law for ``width`` flights; the last argument names the vehicle's effectors."""
    law = ProcessLaw(source, width, further[-1])
    address = ctypes.cast(law.callback, ctypes.c_void_p).value or 0
    return OpenLaw(address, 0, law, law.close)


PROCESS = LawBackend(open_process, lambda *_: None)
