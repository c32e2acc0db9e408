"""Campaign files of Python functions, programs and imported tables."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from abhv_mc.campaign.file.config import Execution
from abhv_mc.campaign.file.systems import Contents, SystemsCampaign, read_systems
from abhv_mc.custom_code.read_guard import is_regular
from abhv_mc.io.documents import CommaKeys, Document, Problems, StrictModel, YesNo
from abhv_mc.io.input_files import expand
from abhv_mc.io.messages import Refusal, one_of
from abhv_mc.io.units import Time


class Simulator(StrictModel):
    """Custom simulator: a Python function, or a program that reads and writes JSON Lines."""

    python: str | None = None
    """Python file with a function fly(inputs, settings) that simulates one flight"""
    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    """program and its arguments; it reads one line of JSON per flight and writes one line per
    result"""
    files: tuple[str, ...] = ()
    """other files that the simulator consists of or reads: files, folders, or patterns with *;
    the name of an empty folder, or of a folder to be created, ends with /"""
    folder: str = "."
    """folder of the simulator, to which all file names are relative; each process runs in a
    temporary folder with copies of the files"""
    time_limit: Annotated[Time, Field(gt=0.0)] = 60.0
    """limit on the elapsed time of one flight"""
    repeatable: YesNo = True
    """whether equal inputs give equal results; if not, the simulator draws independent noise for
    each flight in each process"""
    start_limit: Annotated[Time, Field(gt=0.0)] = 600.0
    """time allowed for the start: to import the Python file, or, in addition to time_limit,
    until the first reply of a program"""
    flights_per_process: Annotated[int, Field(ge=1)] | None = None
    """number of flights after which a simulator process is replaced; default: never"""

    @model_validator(mode="after")
    def _one_of_both(self) -> "Simulator":
        if (self.python is None) == (self.command is None):
            raise Refusal(
                "both 'python' and 'command' are set"
                if self.command
                else "neither 'python' nor 'command' is set",
                "either 'python' or 'command'",
            )
        return self

    def find_files(self, folder: Path) -> dict[str, Path]:
        """Return the simulator's files by path relative to ``folder``.

        The files that start the simulator come first, then ``files``. Raise Refusal if a file is
        outside ``folder``.
        """
        base = Path(os.path.normpath(folder))
        start_paths = {
            word: Path(os.path.normpath(base / word))
            for word in (self.python, *(self.command or ()))
            if word
        }
        for word, path in start_paths.items():
            if ".." in Path(word).parts and is_regular(str(path)) and not path.is_relative_to(base):
                raise Refusal(
                    f"the file '{word}' is outside the simulator's folder",
                    "'folder: ..' (or a higher folder) in 'simulator', and names relative to that "
                    "folder",
                    ("python" if self.python else "command",),
                )
        named = [
            path
            for path in start_paths.values()
            if path.is_relative_to(base) and is_regular(str(path))
        ]
        if self.python and not named:
            raise Refusal(
                f"'{self.python}' does not exist in the simulator's folder",
                "a Python file in the folder of the campaign file, or in the folder named by "
                "'folder'",
                ("python",),
            )
        declared = expand(base, self.files, self.find_folders(base))
        return {path.relative_to(base).as_posix(): path for path in (*named, *declared)}

    def find_folders(self, folder: Path) -> list[str]:
        """Return the entries of ``files`` that are empty folders."""
        return [
            entry
            for entry in self.files
            if not (Path(entry).is_absolute() or ".." in Path(entry).parts)
            and (
                not any(path.is_file() for path in (folder / entry).rglob("*"))
                if (folder / entry).is_dir()
                else entry.endswith("/") and not (folder / entry).exists()
            )
        ]


class SimulatorExecution(Execution):
    """Execution settings without the time limit, which is a setting of the simulator."""

    isolation: ClassVar = "auto"  # type: ignore[misc]
    flight_time_limit: ClassVar = None  # type: ignore[misc]


class SimulatorCampaign(SystemsCampaign):
    """Campaign file for a custom simulator: a Python function or a program."""

    simulator: Simulator
    """program that computes the flights, instead of vehicle, mission and controllers"""
    execution: SimulatorExecution = Field(default_factory=SimulatorExecution)
    """execution settings"""


class TableCampaign(SystemsCampaign, CommaKeys):
    """Campaign file for flights of an imported table."""

    independent: YesNo = False
    """whether the imported flights are independent draws from the dispersions; statistical tests
    check this"""
    columns: dict[str, str] = {}
    """mapping from the name of an input or metric (or `system`, `outcome`, `end_time` or
    `flight`) to the heading of its column in the imported table; default: the name itself, with
    or without a unit"""
    first_flight: Literal[0, 1] | None = None
    """number of the first flight in an imported table without a flight 0, if another table
    contains a flight 0"""

    @model_validator(mode="after")
    def _check_columns(self) -> "TableCampaign":
        column_names = (*self.inputs, *self.metrics, "system", "outcome", "end_time", "flight")
        for name in self.columns:
            if name not in column_names:
                raise Refusal(
                    f"unknown name '{name}'", one_of(column_names, name), ("columns", name)
                )
        return self


def read_simulator(document: Document, model: SimulatorCampaign, errors: Problems) -> Contents:
    """Return the contents of a campaign file; append problems to ``errors``."""
    with errors.collect("simulator"):
        model.simulator.find_files(document.path.parent / model.simulator.folder)
    return read_systems(document, model, errors)


def read_table(document: Document, model: TableCampaign, errors: Problems) -> Contents:
    """Return the contents of a campaign file; append problems to ``errors``."""
    for key in ("unknowns", "derived", "stop", "sampling", "histories"):
        if key in model.model_fields_set:
            problem = f"'{key}' does not apply to imported flights"
            expected = "a campaign with a simulator, or no such key"
            errors.add_key((key,), problem, expected)
    return replace(read_systems(document, model, errors), is_imported=True)
