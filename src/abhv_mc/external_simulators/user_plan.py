"""Flight plans of custom simulators."""

import json
import os
import re
import sys
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.read_guard import is_regular
from abhv_mc.custom_code.source import UserSource
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.signals import Signal

_PYTHON = (sys.executable, "-P", str(Path(__file__).with_name("python_lines.py")))


@dataclass(frozen=True)
class UserPlan:
    """Data for the flights of one system, except inputs; sent to workers."""

    command: tuple[str, ...]
    folder: str  # folder of the simulator
    files: tuple[tuple[str, str], ...]  # (path in the folder, SHA-256) of each file
    time_limit: float  # limit in s on the elapsed time of a flight
    controller: str = ""  # name of the system in the campaign
    python: str = ""  # file of a Python function, or '' for a program
    settings: str = ""  # settings of the system as JSON
    inputs: tuple[str, ...] = ()
    seeds: tuple[bool, ...] = ()  # whether each input is an integer seed
    metrics: tuple[Metric, ...] = ()
    outcomes: dict[str, int] = field(default_factory=dict)  # numbers of the outcome codes
    channels: tuple[Signal, ...] = ()  # channels of the returned history
    rate: float = 10.0  # sampling rate of stored histories in Hz
    band_rate: float = 5.0  # sampling rate of envelopes in Hz

    timing: ClassVar = None  # None, because each flight has its own times
    sources: ClassVar[tuple[UserSource, ...]] = ()
    folders: tuple[str, ...] = ()  # required empty folders
    reply_size: int = 0  # bytes of a binary reply; 0 for lines of JSON
    start_limit: float = 600.0  # time limit in s for the start
    flights_per_process: int | None = None
    campaign_folder: str = ""  # folder of the campaign file
    check: int = 0  # number of a process used only for checks; 0 or -1 otherwise
    is_proven: bool = False  # whether each block ends with a silence check
    # numbers of flights and surplus lines observed by other processes
    seen: tuple[int, int] = (0, 0)

    @property
    def process(self) -> tuple[object, ...]:
        """Key of the processes that can run this plan, and possibly plans of other systems."""
        files = self.folder, self.files, self.folders
        return self.command, self.python, files, self.flights_per_process, self.check

    @property
    def system(self) -> tuple[object, ...]:
        """Key of the simulated system, independent of its process."""
        return self.command, self.python, self.folder, self.files, self.controller

    def argv(self, working_folder: Path) -> list[str]:
        """Return the command that starts a process in its working folder."""
        names = [name for name, _ in self.files]
        if self.python:
            return [*_PYTHON, self.python, self.folder, self.campaign_folder, *names]
        return [
            str(working_folder / name)
            if (name := self._find_declared(word)) and (i == 0 or Path(word).is_absolute())
            else word
            for i, word in enumerate(self.command)
        ]

    def _find_declared(self, word: str) -> str:
        """Return the declared file to which a word of the command refers, or ''."""
        name = os.path.relpath(os.path.normpath(Path(self.folder, word)), self.folder)
        return name if any(name == declared for declared, _ in self.files) else ""

    def name_undeclared(self, message: str) -> str:
        """Return a hint if an error message names a file missing in `files`, else ''."""
        for word in re.findall(r"[\w.+/-]+", message):
            for path in (word.rstrip("."), f"{word.replace('.', '/')}.py"):
                name = os.path.normpath(path)
                is_inside = name[0] not in "./" and is_regular(f"{self.folder}/{name}")
                if is_inside and not self._find_declared(name):
                    return f"; 'files' does not list {name}, which is in the simulator's folder"
        return ""

    @cached_property
    def expected(self) -> set[str]:
        """Keys that a flight must return."""
        returned = [metric.name for metric in self.metrics if not metric.of]
        return {*returned, *(["history"] if self.channels else [])}

    @cached_property
    def _template(self) -> str:
        parts = (
            f"{json.dumps(name)}: %{'d' if seed else 'r'}"
            for name, seed in zip(self.inputs, self.seeds, strict=True)
        )
        settings = self.settings.replace("%", "%%")
        return f'{{"inputs": {{{", ".join(parts)}}}, "settings": {settings}, "flight": '

    def requests(self, rows: Floats) -> list[bytes]:
        """Return the beginning of the JSON line of each flight in ``rows`` [flight, input]."""
        return [(self._template % tuple(row)).encode() for row in rows.tolist()]
