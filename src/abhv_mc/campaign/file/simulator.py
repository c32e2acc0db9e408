"""Campaign file of a user's simulator, with inputs and outputs in its own units."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, model_validator

from abhv_mc.campaign.file.config import Campaign, Execution, Name
from abhv_mc.campaign.file.user_metrics import MetricName
from abhv_mc.control.law_file import expand
from abhv_mc.flight.channels import Signal
from abhv_mc.flight.metrics import MARGIN_NAMES, Bad, Metric, label_of
from abhv_mc.flight.outcome import Outcome
from abhv_mc.io.documents import Document, InputError, Refusal, StrictModel, one_of
from abhv_mc.io.units import Time
from abhv_mc.kernel.flight.counting import Statistic
from abhv_mc.plant.parameters import Parameter, Parameters

SYSTEMS = "systems"
_TAKEN = {
    "flight",
    "controller",
    "system",
    "outcome",
    "end_time",
    "end_time_s",
    "history",
    "error",
    "reason",
    "point",
}
_OUTCOMES = {Outcome.OK.code, Outcome.FAILED_TO_RUN.code}
Unit = Annotated[str, Field(min_length=1, max_length=30)]

YesNo = Annotated[
    bool,
    BeforeValidator(
        lambda value: (
            {"yes": True, "no": False}.get(value, value) if isinstance(value, str) else value
        ),
        json_schema_input_type=bool | Literal["yes", "no"],
    ),
]


class Simulator(StrictModel):
    """User's simulator: a Python function, or a program that exchanges JSON lines."""

    python: str | None = Field(
        None, description="Python file with def fly(inputs, settings): one flight"
    )
    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = Field(
        None,
        description="a program and its arguments: a flight is a line of JSON in, and a line out",
    )
    files: tuple[str, ...] = Field(
        (),
        description="other files that it consists of or reads: files, folders, or patterns with *;"
        " an empty folder, or one to be made, ends with /",
    )
    folder: str = Field(
        ".",
        description="folder of the simulator, to which these names are relative;"
        " each process runs in a temporary folder with copies of them",
    )
    time_limit: Annotated[Time, Field(gt=0.0)] = Field(
        60.0, description="of one flight, by the clock"
    )
    repeatable: YesNo = Field(
        True,
        description="no: it draws noise that is independent between flights and processes",
    )
    start_limit: Annotated[Time, Field(gt=0.0)] = Field(
        600.0,
        description="of a start: to import the Python file, or beyond time_limit"
        " to a program's first answer",
    )
    flights_per_process: Annotated[int, Field(ge=1)] | None = Field(
        None, description="number of flights after which a process is replaced; default: never"
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> "Simulator":
        if (self.python is None) == (self.command is None):
            raise Refusal("both" if self.command else "neither", "either 'python' or 'command'")
        return self

    def find_files(self, folder: Path) -> dict[str, Path]:
        """Return the simulator's files by their path relative to ``folder``.

        The files that start it come first, then ``files``. Raise Refusal.
        """
        base = Path(os.path.normpath(folder))
        start_paths = {
            word: Path(os.path.normpath(base / word))
            for word in (self.python, *(self.command or ()))
            if word
        }
        for word, path in start_paths.items():
            if ".." in Path(word).parts and path.is_file() and not path.is_relative_to(base):
                raise Refusal(
                    f"'{word}', a file outside the simulator's folder",
                    "'folder: ..' (or further up) in 'simulator', and names from there",
                    ("python" if self.python else "command",),
                )
        named = [
            path for path in start_paths.values() if path.is_relative_to(base) and path.is_file()
        ]
        if self.python and not named:
            raise Refusal(
                f"'{self.python}'",
                "a Python file in this file's folder, or in 'folder'",
                ("python",),
            )
        declared = expand(base, self.files, self.find_folders(base))
        return {path.relative_to(base).as_posix(): path for path in (*named, *declared)}

    def find_folders(self, folder: Path) -> list[str]:
        """Return the entries of ``files`` that are folders without a file."""
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


InputName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_.]*$", max_length=60)]


class OwnChannel(StrictModel):
    """Column of the history that a flight returns."""

    unit: Unit = Field("-", description="any text; '-' of a plain number")
    doc: str = Field("", description="description for the report")


class Input(OwnChannel):
    """Input of a flight."""

    nominal: float = Field(0.0, description="its nominal value, in this unit")
    seed: YesNo = Field(
        False, description="yes: a whole number drawn for each flight, and no quantity"
    )


class OwnMetric(OwnChannel):
    """Metric that a flight returns."""

    bad: Bad | None = Field(
        None,
        description="undesired values: high, low, or those of the largest size; default: high",
    )
    label: str | None = Field(
        None, description="name in the report, without the unit; default: its name"
    )

    def record(self, name: str) -> Metric:
        """Return the metric as a record of the tables of metrics."""
        label = self.label or label_of(name, "-")
        return Metric(
            name=name,
            unit=self.unit,
            doc=self.doc,
            label=label,
            bad=self.bad or "high",
            group="user",
            of="",
            statistic=Statistic.MAX,
        )


class SimulatorExecution(Execution):
    """Execution settings without a time limit, which belongs to the simulator."""

    isolation: ClassVar = "auto"  # type: ignore[misc]
    flight_time_limit: ClassVar = None  # type: ignore[misc]


class SimulatorCampaign(Campaign):
    """Campaign file with a user's simulator.

    Fields of the built-in simulator are class variables that are None.
    """

    simulator_maker: ClassVar = "abhv_mc.external_simulators.simulator:make_simulator"
    vehicle: ClassVar = None  # type: ignore[misc]
    mission: ClassVar = None  # type: ignore[misc]
    controllers: ClassVar = None  # type: ignore[misc]
    channels: ClassVar = None  # type: ignore[misc]
    margins: ClassVar = None  # type: ignore[misc]
    tune: ClassVar = None  # type: ignore[misc]
    figures: ClassVar = None  # type: ignore[misc]
    simulator: Simulator | None = Field(
        None,
        description="program that computes the flights, in place of vehicle, mission and "
        "controllers; without it: `import flights`",
    )
    independent: YesNo = Field(
        False,
        description="without a simulator: yes if flights are independent draws of the dispersions, "
        "which is tested",
    )
    columns: dict[str, str] = Field(
        {},
        description="column headings of an imported table, keyed by the name of an input or "
        "metric, or by system, outcome, end_time or flight; default: the names themselves, with or "
        "without units",
    )
    systems: Annotated[dict[Name, dict[str, Any]], Field(min_length=1)] = Field(
        {"system": {}},
        description="compared systems: settings of the simulator by name; the first has to meet "
        "the requirements",
    )
    inputs: dict[InputName, Input] = Field({}, description="inputs of a flight, by name")
    metrics: Annotated[dict[MetricName, OwnMetric], Field(min_length=1)] = Field(  # type: ignore[assignment]
        description="metrics that a flight returns, by name"
    )
    outcomes: dict[MetricName, str] = Field(
        {},
        description="ways in which a flight ends early, by the code that it returns: a sentence "
        "for each",
    )
    histories: dict[MetricName, OwnChannel] = Field(
        {}, description="columns of the history that a flight returns beside its time (s), by name"
    )
    execution: SimulatorExecution = Field(
        default_factory=SimulatorExecution, description="execution settings"
    )

    @model_validator(mode="after")
    def _names(self) -> "SimulatorCampaign":
        taken = {
            "inputs": _TAKEN,
            "metrics": {*_TAKEN, *MARGIN_NAMES, *self.inputs},
            "outcomes": _OUTCOMES,
        }
        taken["histories"] = {*_TAKEN, "time"}
        for key, names in taken.items():
            for name in getattr(self, key):
                if name in names:
                    expected = f"another name; taken are {', '.join(sorted(names))}"
                    raise Refusal(f"'{name}', a name that is taken", expected, (key, name))
        column_names = (*self.inputs, *self.metrics, "system", "outcome", "end_time", "flight")
        for name in self.columns:
            if name not in column_names:
                raise Refusal(f"'{name}'", one_of(column_names, name), ("columns", name))
        if self.columns and self.simulator:
            raise Refusal("'columns' beside a simulator", "no simulator, or none", ("columns",))
        if self.independent and self.simulator:
            raise Refusal(
                "'independent' beside a simulator", "'sampling', which says it", ("independent",)
            )
        return self

    @property
    def returned_channels(self) -> tuple[Signal, ...]:
        """Channels of a flight's history."""
        return tuple(Signal(name, entry.unit, entry.doc) for name, entry in self.histories.items())

    @property
    def parameters(self) -> Parameters:
        """Parameters that flights accept."""
        entries = self.inputs.items()
        return Parameters(
            tuple(
                Parameter(n, e.unit, e.nominal, e.doc, of_user=True, seed=e.seed)
                for n, e in entries
            )
        )


def systems_key(data: Mapping[str, Any]) -> str:
    """Return the key of a campaign file that lists the compared systems."""
    return SYSTEMS if is_own(data) else "controllers"


def is_own(data: object) -> bool:
    """Return whether a campaign uses a user's simulator or imported flights."""
    return isinstance(data, dict) and ("simulator" in data or "inputs" in data)


def check_simulator(document: Document, model: SimulatorCampaign, errors: list[InputError]) -> None:
    """Check the simulator's entries; append problems to ``errors``."""
    try:
        if model.simulator:
            model.simulator.find_files(document.path.parent / model.simulator.folder)
    except Refusal as refusal:
        errors.append(document.error(("simulator", *refusal.keys), refusal.found, refusal.expected))
    for key in ("unknowns", "derived", "stop", "sampling", "histories"):
        if not model.simulator and key in model.model_fields_set:
            problem = f"'{key}' of flights that have been flown"
            errors.append(document.key_error((key,), problem, "a simulator, or none of it"))
    if "envelopes" in model.keep.model_fields_set and not model.histories:
        errors.append(
            document.key_error(("keep", "envelopes"), "envelopes of no 'histories'", "'histories'")
        )
    for key, settings in (("histories", model.keep.histories), ("envelopes", model.keep.envelopes)):
        if "channels" in settings.model_fields_set:
            problem = "channels of this program's own simulator"
            errors.append(
                document.key_error(
                    ("keep", key, "channels"), problem, "nothing: all 'histories' are kept"
                )
            )
