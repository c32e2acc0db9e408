"""Custom simulators: Python functions, programs, and imported tables, with their campaign files.

Files that native code reads unnoticed by Python audit hooks are detected on Linux only.
"""

import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NoReturn

from pydantic import Field, model_validator

from abhv_mc import interfaces
from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.config import THREADS, Execution
from abhv_mc.campaign.file.experiment import Experiment, check_user_code
from abhv_mc.campaign.file.systems import (
    SYSTEMS,
    Contents,
    Registered,
    SystemsCampaign,
    read_systems,
)
from abhv_mc.custom_code.read_guard import is_regular, simulator_guard
from abhv_mc.custom_code.source import UserSource, check_trusted
from abhv_mc.external_simulators.process import (
    LostFlightError,
    Process,
    current_pool,
    end_processes,
)
from abhv_mc.external_simulators.user_flights import fly_user_simulator, seconds_of_a_flight
from abhv_mc.external_simulators.user_plan import UserPlan
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.interfaces import Capabilities, Engine, Recorded, StoredPlans
from abhv_mc.io.documents import CommaKeys, Document, Problems, StrictModel, YesNo
from abhv_mc.io.input_files import expand, read_input
from abhv_mc.io.messages import InputErrors, Refusal, one_of
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
            errors.add_key((key,), problem, "a campaign with a simulator, or no such key")
    return replace(read_systems(document, model, errors), is_imported=True)


_PACKAGES = {"site-packages", "dist-packages"}


def find_native_reads(processes: Iterable[int], plan: UserPlan, started: float) -> list[str]:
    """Return undeclared files that ``processes`` and their descendants map or keep open.

    Files created after ``started`` (s since the epoch) are omitted, because the processes probably
    created them. For programs other than Python functions, only files in the folders of the
    simulator and the campaign are returned, because the ownership of other files is unknown.
    """
    paths = set[str]()
    for process in {member for first in processes for member in _family(first)}:
        folder = _link(f"/proc/{process}/cwd")
        names = (name for name, _ in plan.files)
        guard = simulator_guard(names, plan.folder, plan.campaign_folder, folder, started)
        for path in _open_files(process):
            if not is_regular(path) or guard.allows(path) or _PACKAGES & set(Path(path).parts):
                continue
            if plan.python or path.startswith(guard.studies):
                paths.add(path)
    return sorted(paths)


def _family(process: int) -> set[int]:
    """Return the IDs of a process and its descendants."""
    family = {process}
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{process}/task").iterdir():
            for child in (task / "children").read_text().split():
                family |= _family(int(child))
    return family


def _open_files(process: int) -> set[str]:
    """Return the paths of files that a process has opened for reading or mapped."""
    paths = set[str]()
    with contextlib.suppress(OSError):
        lines = Path(f"/proc/{process}/maps").read_text(errors="replace").splitlines()
        paths = {line.split(maxsplit=5)[5] for line in lines if line.count("/")}
    with contextlib.suppress(OSError):
        for descriptor in os.listdir(f"/proc/{process}/fd"):  # noqa: PTH208
            if _is_read(process, descriptor):
                paths.add(_link(f"/proc/{process}/fd/{descriptor}"))
    return paths - {""}


def _is_read(process: int, descriptor: str) -> bool:
    """Return whether a file descriptor is open for reading."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        text = Path(f"/proc/{process}/fdinfo/{descriptor}").read_text()
        flags = int(text.partition("flags:")[2].split()[0], 8)
        return flags & (os.O_WRONLY | os.O_RDWR) != os.O_WRONLY
    return False


def _link(path: str) -> str:
    with contextlib.suppress(OSError):
        return os.readlink(path)  # noqa: PTH115
    return ""


_BY_ORDER = (
    "replies of the program are matched to requests in the order of arrival, unless each reply "
    "repeats the value of the key 'flight'"
)


class ExternalSimulator(interfaces.Simulator):
    """Custom simulator: a Python function, or a program that exchanges JSON lines."""

    capabilities = Capabilities(is_repeatable=False)
    fly = staticmethod(fly_user_simulator)

    def __init__(self, experiment: Experiment) -> None:
        super().__init__(experiment)
        self.model: Any = experiment.model
        self.states_noise = not self.model.simulator.repeatable

    @cached_property
    def engine(self) -> Engine:
        return replace(super().engine, isolation=THREADS, close=end_processes, records_lost=True)

    def find_simulator(self) -> tuple[Simulator, Path]:
        """Return the settings and folder of the simulator."""
        simulator = self.model.simulator
        return simulator, self.experiment.document.path.parent / simulator.folder

    def find_code(self) -> list[tuple[Path, UserSource]]:
        simulator, base = self.find_simulator()
        files = tuple((name, read_input(path)) for name, path in simulator.find_files(base).items())
        text = json.dumps([simulator.python, simulator.command])
        start = base / (simulator.python or (simulator.command or ("",))[0])
        return [(start, UserSource(text, str(start), files))]

    def pack(self, take: Callable[..., str], copies: dict[str, Path]) -> dict[str, Any]:
        entries: dict[str, Any] = {SYSTEMS: self.model.systems}
        target, (simulator, base) = "inputs/simulator", self.find_simulator()
        for name, path in simulator.find_files(base).items():
            copies[f"{target}/{name}"] = path
        written = self.experiment.document.entries
        data = {**written["simulator"], "folder": target}
        if folders := simulator.find_folders(base):  # Results folders contain no empty folders.
            data["files"] = [
                f"{entry.rstrip('/')}/" if entry in folders else entry for entry in simulator.files
            ]
        return {"simulator": data, **entries}

    def make_plans(self, names: Sequence[str]) -> dict[str, UserPlan]:
        check_user_code(self.experiment)
        return self._make_plans(names, self.model)

    def restore_plans(
        self, stored: StoredPlans, names: Sequence[str], trusted: bool = False
    ) -> dict[str, UserPlan]:
        ((_, source),) = self.find_code()
        check_trusted(source, trusted)
        if self.model.systems.keys() >= set(names):
            return self._make_plans(names, self.model)
        # The system was simulated before but is not requested now.
        return self._make_plans(names, stored.read_campaign())

    def _make_plans(self, names: Sequence[str], model: Any) -> dict[str, UserPlan]:
        """Return the plans of systems with the settings of ``model``."""
        (simulator, base), experiment = self.find_simulator(), self.experiment
        ((_, source),) = self.find_code()
        records, keep = experiment.parameters.records, experiment.model.keep
        lost = Outcome.FAILED_TO_RUN.code
        return {
            name: UserPlan(
                controller=name,
                command=simulator.command or (),
                folder=str(base.resolve()),
                files=tuple(
                    (name_in_folder, hashlib.sha256(data).hexdigest())
                    for name_in_folder, data in source.files
                ),
                python=simulator.python or "",
                settings=json.dumps(model.systems[name]),
                inputs=tuple(record.name for record in records),
                seeds=tuple(record.seed for record in records),
                metrics=experiment.measured,
                outcomes={code: n for code, n in self.outcomes.numbers.items() if code != lost},
                time_limit=simulator.time_limit,
                folders=tuple(simulator.find_folders(base)),
                start_limit=simulator.start_limit,
                flights_per_process=simulator.flights_per_process,
                channels=self.channels,
                rate=keep.histories.rate,
                band_rate=keep.envelopes.rate,
                campaign_folder=str(experiment.document.path.parent.resolve()),
            )
            for name in names
        }

    def time_of_flight(self, plans: Sequence[UserPlan]) -> float | None:
        return seconds_of_a_flight(plans)

    def prove(self, plan: UserPlan, check: int = 0) -> UserPlan:
        most = 1 if check < 0 else plan.flights_per_process
        return replace(plan, check=check, is_proven=True, flights_per_process=most)

    def describe_events(self, system: str, events: Mapping[str, int]) -> list[str]:
        if not events.get("surplus"):
            return []
        return [
            f"'{system}' wrote unrequested lines. Flights with possibly mismatched replies were "
            "computed again one by one; flights with two replies failed to run"
        ]

    def find_undeclared_reads(self, plan: UserPlan, since: float) -> Iterable[str]:
        numbers = [process.number for process in list(current_pool().all) if process.number]
        return find_native_reads(numbers, plan, since)

    def try_out(self) -> Iterator[str]:
        plan = next(iter(self.make_plans(self.systems).values()))
        try:
            Process(plan).end()
        except (LostFlightError, OSError) as error:
            problem = f"{error}{plan.name_undeclared(str(error))}"
            error_in_file = self.experiment.document.key_error(
                ("simulator",), problem, "a simulator that starts"
            )
            raise InputErrors([error_in_file]) from None
        if self.model.simulator.command:
            yield _BY_ORDER


class ImportedTable(interfaces.Simulator):
    """Simulator interface for flights that another simulator computed."""

    origin = "a table"
    capabilities = Capabilities(can_rerun=False, is_repeatable=False)

    def __init__(self, experiment: Experiment) -> None:
        super().__init__(experiment)
        self.independent = experiment.model.independent

    def find_code(self) -> NoReturn:
        raise self.experiment.document.error(
            (),
            "this campaign has no simulator and cannot be run",
            "the key 'simulator', or `abhv-mc import flights TABLE` for existing results",
        )

    def make_plans(self, names: Sequence[str]) -> NoReturn:
        self.find_code()

    @staticmethod
    def fly(plan: Any, rows: Floats, recorded: Recorded = None) -> NoReturn:
        raise NotImplementedError


PYTHON = Registered(ExternalSimulator, SimulatorCampaign, read_simulator)
TABLE = Registered(ImportedTable, TableCampaign, read_table)
