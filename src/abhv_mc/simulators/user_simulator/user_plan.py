"""What the flights of one system of a user's simulator need, and whether this user may run it."""

import json
import os
import re
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from abhv_mc.array_types import Floats
from abhv_mc.flight.channels import Signal
from abhv_mc.flight.metrics import Metric
from abhv_mc.user_code.source import UserSource

_PYTHON = (sys.executable, "-P", str(Path(__file__).with_name("python_lines.py")))


@dataclass(frozen=True)
class UserPlan:
    """Everything that is needed to fly one system, apart from its flights' inputs; it travels to other machines."""

    controller: str  # its name in the campaign
    command: tuple[str, ...]
    folder: str  # that it lies in
    files: tuple[tuple[str, str], ...]  # place in the folder and SHA-256 of what it consists of
    python: str  # the file of a Python function, '' for a program
    settings: str  # JSON
    inputs: tuple[str, ...]
    seeds: tuple[bool, ...]  # which of these are whole numbers
    metrics: tuple[Metric, ...]
    outcomes: dict[str, int]  # codes that a flight may return, with their numbers
    time_limit: float  # s of one flight, by the clock
    channels: tuple[Signal, ...] = ()  # of the history that a flight returns
    rate: float = 10.0  # Hz that it is recorded with, and for bands over time
    band_rate: float = 5.0

    timing: ClassVar = None  # each flight has times of its own
    sources: ClassVar[tuple[UserSource, ...]] = ()
    folders: tuple[str, ...] = ()  # empty ones that it needs
    start_limit: float = 600.0  # s to start
    flights_per_process: int | None = None
    campaign_folder: str = ""  # that the campaign file lies in
    check: int = 0  # number of the process that simulates it for a check; 0: for the campaign
    is_proven: bool = False  # whether each block of its flights ends with a proof of silence
    seen: tuple[int, int] = (0, 0)  # flights and surplus lines that other processes know of

    @property
    def process(self) -> tuple[object, ...]:
        """Key of the processes that can run this plan: they may run other systems, too."""
        files = self.folder, self.files, self.folders
        return self.command, self.python, files, self.flights_per_process, self.check

    @property
    def system(self) -> tuple[object, ...]:
        """Key of what is simulated, in whatever process."""
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
        """Return the name of the declared file that a word of the command names, or ''."""
        name = os.path.relpath(os.path.normpath(Path(self.folder, word)), self.folder)
        return name if any(name == declared for declared, _ in self.files) else ""

    def name_undeclared(self, message: str) -> str:
        """Return what is wrong if an error message names a file that `files` lacks, or ''."""
        for word in re.findall(r"[\w.+/-]+", message):
            for path in (word.rstrip("."), f"{word.replace('.', '/')}.py"):
                name = os.path.normpath(path)
                is_inside = name[0] not in "./" and Path(self.folder, name).is_file()
                if is_inside and not self._find_declared(name):
                    return f"; {name} lies in the simulator's folder but not in 'files'"
        return ""

    @cached_property
    def expected(self) -> set[str]:
        """What a flight has to return."""
        return {*(metric.name for metric in self.metrics), *(["history"] if self.channels else [])}

    @cached_property
    def _template(self) -> str:
        parts = (
            f"{json.dumps(name)}: %{'d' if seed else 'r'}"
            for name, seed in zip(self.inputs, self.seeds, strict=True)
        )
        settings = self.settings.replace("%", "%%")
        return f'{{"inputs": {{{", ".join(parts)}}}, "settings": {settings}, "flight": '

    def requests(self, rows: Floats) -> list[bytes]:
        """Return a line of JSON for each of ``rows`` [flight, input], up to the flight's text."""
        return [(self._template % tuple(row)).encode() for row in rows.tolist()]
