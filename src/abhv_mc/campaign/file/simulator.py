"""Campaign file for a custom simulator, whose inputs and outputs may have any units."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeGuard

from pydantic import BeforeValidator, Field, model_validator

from abhv_mc.campaign.file.config import Campaign, Execution, Name
from abhv_mc.campaign.file.user_metrics import MetricName
from abhv_mc.control.law_file import expand
from abhv_mc.flight.channels import Signal
from abhv_mc.flight.metrics import MARGIN_NAMES, Bad, Metric, label_of
from abhv_mc.flight.outcome import Outcome
from abhv_mc.io.documents import CommaKeys, Document, InputError, Refusal, StrictModel, one_of
from abhv_mc.io.phrases import quoted
from abhv_mc.io.units import ANGLE, Time, parse_unit
from abhv_mc.kernel.flight.counting import Statistic
from abhv_mc.plant.parameters import Parameter, Parameters
from abhv_mc.user_code.read_guard import is_regular

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
    """Custom simulator: a Python function, or a program that reads and writes JSON Lines."""

    python: str | None = Field(
        None,
        description="Python file with a function fly(inputs, settings) that simulates one flight",
    )
    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = Field(
        None,
        description=(
            "program and its arguments; it reads one line of JSON per flight and writes one line "
            "per result"
        ),
    )
    files: tuple[str, ...] = Field(
        (),
        description=(
            "other files that the simulator consists of or reads: files, folders, or patterns "
            "with *; the name of an empty folder, or of a folder to be created, ends with /"
        ),
    )
    folder: str = Field(
        ".",
        description=(
            "folder of the simulator, to which all file names are relative; each process runs in "
            "a temporary folder with copies of the files"
        ),
    )
    time_limit: Annotated[Time, Field(gt=0.0)] = Field(
        60.0, description="limit on the elapsed time of one flight"
    )
    repeatable: YesNo = Field(
        True,
        description=(
            "whether equal inputs give equal results; if not, the simulator draws independent "
            "noise for each flight in each process"
        ),
    )
    start_limit: Annotated[Time, Field(gt=0.0)] = Field(
        600.0,
        description=(
            "time allowed for the start: to import the Python file, or, in addition to "
            "time_limit, until the first reply of a program"
        ),
    )
    flights_per_process: Annotated[int, Field(ge=1)] | None = Field(
        None,
        description="number of flights after which a simulator process is replaced; default: never",
    )

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


InputName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_.]*$", max_length=60)]


class Quantity(StrictModel):
    """Quantity of a custom simulator."""

    unit: Unit = Field("-", description="unit of the quantity, as free text; '-' if dimensionless")
    doc: str = Field("", description="description of the quantity in the report")


class HistoryChannel(Quantity):
    """Column of the history that a flight returns."""

    circular: YesNo = Field(
        False,
        description=(
            "whether the channel is an angle of which a full turn changes nothing, such as a "
            "heading; the unit must then be an angle, such as deg or rad"
        ),
    )

    @model_validator(mode="after")
    def _check_unit(self) -> "HistoryChannel":
        if self.circular and parse_unit(self.unit)[1] != ANGLE.exponents:
            raise Refusal(
                f"the unit '{self.unit}' of a circular channel is not an angle",
                "the unit deg or rad",
                ("unit",),
            )
        return self


class Input(Quantity):
    """Input of a flight for a custom simulator."""

    nominal: float = Field(0.0, description="nominal value, in the unit of the input")
    seed: YesNo = Field(
        False, description="whether the input is a random seed, an integer drawn for each flight"
    )


class OwnMetric(Quantity):
    """Metric that a custom simulator returns for a flight."""

    bad: Bad | None = Field(
        None,
        description="which values are worse: high, low, or large in magnitude; default: high",
    )
    label: str | None = Field(
        None, description="name of the metric in the report, without unit; default: the key"
    )

    def record(self, name: str) -> Metric:
        """Return the metric as a record, in the same form as built-in metrics."""
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
    """Execution settings without the time limit, which is a setting of the simulator."""

    isolation: ClassVar = "auto"  # type: ignore[misc]
    flight_time_limit: ClassVar = None  # type: ignore[misc]


class SimulatorCampaign(Campaign, CommaKeys):
    """Campaign file with a custom simulator or imported flights.

    Fields that apply only to the built-in simulator are class variables with the value None.
    """

    simulator_maker: ClassVar = "abhv_mc.external_simulators.simulator:make_simulator"
    vehicle: ClassVar = None  # type: ignore[misc]
    mission: ClassVar = None  # type: ignore[misc]
    controllers: ClassVar = None  # type: ignore[misc]
    channels: ClassVar = None  # type: ignore[misc]
    keep_out: ClassVar = {}  # type: ignore[misc]
    margins: ClassVar = None  # type: ignore[misc]
    tune: ClassVar = None  # type: ignore[misc]
    figures: ClassVar = None  # type: ignore[misc]
    simulator: Simulator | None = Field(
        None,
        description=(
            "program that computes the flights, instead of vehicle, mission and controllers; "
            "omitted for `import flights`"
        ),
    )
    independent: YesNo = Field(
        False,
        description=(
            "whether the imported flights are independent draws from the dispersions; statistical"
            " tests check this"
        ),
    )
    columns: dict[str, str] = Field(
        {},
        description=(
            "mapping from the name of an input or metric (or `system`, `outcome`, `end_time` or "
            "`flight`) to the heading of its column in the imported table; default: the name "
            "itself, with or without a unit"
        ),
    )
    first_flight: Literal[0, 1] | None = Field(
        None,
        description=(
            "number of the first flight in an imported table without a flight 0, if another table "
            "contains a flight 0"
        ),
    )
    systems: Annotated[dict[Name, dict[str, Any]], Field(min_length=1)] = Field(
        {"system": {}},
        description=("systems to compare, keyed by name, each with its own simulator settings"),
    )
    inputs: dict[InputName, Input] = Field({}, description="inputs of a flight, by name")
    metrics: Annotated[dict[MetricName, OwnMetric], Field(min_length=1)] = Field(  # type: ignore[assignment]
        description="metrics that a flight returns, by name"
    )
    outcomes: dict[MetricName, str] = Field(
        {},
        description=(
            "reasons for early termination: one sentence for each code that a flight can return"
        ),
    )
    histories: dict[MetricName, HistoryChannel] = Field(
        {},
        description=(
            "channels of the time history by name; each flight returns them in addition to the "
            "time (s)"
        ),
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
                    expected = f"a name other than {quoted(sorted(names))}"
                    raise Refusal(f"the name '{name}' is already in use", expected, (key, name))
        column_names = (*self.inputs, *self.metrics, "system", "outcome", "end_time", "flight")
        for name in self.columns:
            if name not in column_names:
                raise Refusal(
                    f"unknown name '{name}'", one_of(column_names, name), ("columns", name)
                )
        imported = {"columns", *CommaKeys.model_fields, "first_flight", "independent"}
        for key in sorted(imported & self.model_fields_set) if self.simulator else ():
            raise Refusal(f"'{key}' applies only to imported flights", "no such key", (key,))
        return self

    @property
    def returned_channels(self) -> tuple[Signal, ...]:
        """Channels of the history that a flight returns."""
        return tuple(
            Signal(name, entry.unit, entry.doc, circular=entry.circular)
            for name, entry in self.histories.items()
        )

    @property
    def parameters(self) -> Parameters:
        """Parameters of the flights, defined by ``inputs``."""
        entries = self.inputs.items()
        return Parameters(
            tuple(
                Parameter(n, e.unit, e.nominal, e.doc, of_user=True, seed=e.seed)
                for n, e in entries
            )
        )


def systems_key(data: Mapping[str, Any]) -> str:
    """Return the campaign-file key under which the compared systems are listed."""
    return SYSTEMS if is_own(data) else "controllers"


def is_own(data: object) -> TypeGuard[dict[str, Any]]:
    """Return whether a campaign uses a custom simulator or imported flights."""
    return isinstance(data, dict) and ("simulator" in data or "inputs" in data)


def check_simulator(document: Document, model: SimulatorCampaign, errors: list[InputError]) -> None:
    """Check the entries about the simulator; append problems to ``errors``."""
    try:
        if model.simulator:
            model.simulator.find_files(document.path.parent / model.simulator.folder)
    except Refusal as refusal:
        errors.append(document.error(("simulator", *refusal.keys), refusal.found, refusal.expected))
    for key in ("unknowns", "derived", "stop", "sampling", "histories"):
        if not model.simulator and key in model.model_fields_set:
            problem = f"'{key}' does not apply to imported flights"
            errors.append(
                document.key_error((key,), problem, "a campaign with a simulator, or no such key")
            )
    if "envelopes" in model.keep.model_fields_set and not model.histories:
        errors.append(
            document.key_error(
                ("keep", "envelopes"),
                "envelopes cannot be computed without 'histories'",
                "the key 'histories'",
            )
        )
    for key, settings in (("histories", model.keep.histories), ("envelopes", model.keep.envelopes)):
        if "channels" in settings.model_fields_set:
            problem = "'channels' selects channels of the built-in simulator"
            errors.append(
                document.key_error(
                    ("keep", key, "channels"),
                    problem,
                    "no key 'channels', because all 'histories' are stored",
                )
            )
