"""Models of controller files for custom control laws, and lists of their source files."""

import os
import re
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from abhv_mc.io.documents import File, StrictModel
from abhv_mc.io.input_files import expand
from abhv_mc.io.messages import Refusal, one_of
from abhv_mc.io.units import Frequency, Time, parse_any, parse_in_unit, parse_unit
from abhv_mc_vehicle.kernel.plant.vehicle import MAX_ACTUATORS
from abhv_mc_vehicle.vehicle.shared_keys import located

Rate = Annotated[Frequency, Field(gt=0.0)]
_RATE = Field(100.0, description="control ticks per second")
_PERIOD = Field(
    0,
    ge=0,
    le=100,
    description="period in control ticks, checked for stability margins; "
    "0: determined automatically",
)
_FILES = Field(
    (),
    description="data files and modules of the control law: names, patterns such as "
    "tables/*.csv, or folders",
)
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def _expand_files(value: Any, info: ValidationInfo) -> list[Path]:
    return expand(info.context["document"].path.parent, tuple(map(str, value)))  # type: ignore[index]


def _find_word(word: Any, info: ValidationInfo) -> Path | str:
    """Return a word of a command, or the path of the file in the folder that the word names."""
    path = info.context["document"].path.parent / str(word)  # type: ignore[index]
    return path if path.is_file() and not Path(str(word)).is_absolute() else str(word)


_Files = BeforeValidator(_expand_files, json_schema_input_type=list[str])
_Word = Annotated[Path | str, BeforeValidator(_find_word, json_schema_input_type=str)]


class ControllerModel(StrictModel):
    """Base class of the models of controller files."""

    def warnings(self) -> list[str]:
        """Return warnings about implausible values in the file."""
        return []


class PythonController(ControllerModel):
    """Custom control law in a Python file."""

    law: Literal["python"]
    """kind of control law"""
    file: File
    """Python file of the control law; see abhv_mc.extend"""
    files: tuple[str, ...] = _FILES
    rate: Rate = _RATE
    period: int = _PERIOD
    settings: dict[str, Any] = {}
    """values for the fields of the class Settings, with units if the Python file declares units"""
    commands: dict[str, Any] = {}
    """values for the fields of the class Commands: constants, or values by start time such as {0
    s: 100 m, 5 s: 130 m}"""
    around: File | None = None
    """TLC or LQR controller file; the function filters the measurements for this controller, at
    the rate of this controller"""

    @model_validator(mode="after")
    def _check(self) -> "PythonController":
        for key in ("rate", "period", "commands"):
            if self.around is not None and key in self.model_fields_set:
                raise Refusal(
                    f"a filter has the key '{key}'",
                    f"no key '{key}' in addition to 'around'",
                    (key,),
                )
        find_files(self)
        return self


class CController(ControllerModel):
    """Custom control law in C with the interface of abhv_law.h."""

    law: Literal["c"]
    """kind of control law"""
    library: File | None = None
    """shared library of the control law"""
    sources: tuple[File, ...] = ()
    """C sources of the control law, compiled by cc; replaces the key 'library'"""
    flags: tuple[str, ...] = ("-O2",)
    """compiler flags for cc in addition to -ffp-contract=off"""
    design: File | None = None
    """gains: a Python file with design(), or a CSV file of gains as a function of time"""
    files: tuple[str, ...] = _FILES
    rate: Rate = _RATE
    period: int = _PERIOD
    settings: dict[str, Any] = {}
    """values of the members of the struct abhv_settings: numbers or lists of numbers, with units"""
    units: dict[str, str] = {}
    """SI units of settings, such as {bank_limit: rad}; the values of these settings need a unit"""
    effectors: tuple[str, ...] = Field((), max_length=MAX_ACTUATORS)
    """commanded effectors of the vehicle, in the order of the members of the C struct"""
    onboard: bool = False
    """whether measured->onboard contains data of the nominal vehicle, as in Python control laws"""

    @model_validator(mode="after")
    def _check(self) -> "CController":
        if (self.library is None) == (not self.sources):
            raise Refusal("both or neither of library and sources are set", "exactly one of them")
        for name, unit in self.units.items():
            if name not in self.settings:
                raise Refusal(
                    f"'units' names '{name}', which is not a setting",
                    one_of(self.settings, name),
                    ("units", name),
                )
            with located("units", name):
                if parse_unit(unit)[0] != 1.0:
                    raise Refusal(
                        f"found '{unit}'", "the SI unit of the struct's member, such as rad"
                    )
        for name, value in self.settings.items():
            if not _NAME.fullmatch(name):
                raise Refusal(
                    f"invalid name '{name}' of a setting", "a C identifier", ("settings", name)
                )
            parse_numbers(value, ("settings", name), self.units.get(name))
        find_files(self)
        return self

    @property
    def layout(self) -> "Layout":
        """Name and length of each setting, in the order of the file; a number has length 0."""
        return [
            (name, len(value) if isinstance(value, list) else 0)
            for name, value in self.settings.items()
        ]

    @property
    def numbers(self) -> list[float]:
        """All settings as one list, in SI units."""
        return [
            n
            for name, value in self.settings.items()
            for n in parse_numbers(value, (), self.units.get(name))
        ]


class FmuController(ControllerModel):
    """Custom control law as a Functional Mock-up Unit for co-simulation."""

    law: Literal["fmu"]
    """kind of control law"""
    file: File
    """FMU file (FMI 2.0 or 3.0)"""
    inputs: dict[str, bool | float | str]
    """source of each input: measured.NAME, reference.NAME, onboard.NAME, gains.NAME, time, or a
    constant such as true, 3 or 20 deg"""
    outputs: dict[str, str]
    """name of the FMU output that supplies each field of the command (such as elevator) or each
    commanded effector of the vehicle"""
    params: dict[str, Any] = {}
    """initial values of the FMU's parameters, with units if they have any"""
    design: File | None = None
    """gains: a Python file with design(), or a CSV file of gains as a function of time"""
    files: tuple[str, ...] = _FILES
    rate: Rate = _RATE
    period: int = _PERIOD

    @model_validator(mode="after")
    def _check(self) -> "FmuController":
        for name, value in self.starts.items():
            with located("inputs" if name in self.constants else "params", name):
                parse_any(value)
        find_files(self)
        return self

    @property
    def wired(self) -> dict[str, str]:
        """Names and sources of inputs whose source is not a constant."""
        return {
            name: source
            for name, source in self.inputs.items()
            if isinstance(source, str) and source[:1].isalpha()
        }

    @property
    def constants(self) -> tuple[str, ...]:
        """Names of inputs with a constant value."""
        return tuple(name for name in self.inputs if name not in self.wired)

    @property
    def starts(self) -> dict[str, Any]:
        """Start values of parameters and constant inputs; true becomes 1."""
        values = self.params | {name: self.inputs[name] for name in self.constants}
        return {
            name: float(value) if isinstance(value, bool) else value
            for name, value in values.items()
        }


class ProcessController(ControllerModel):
    """Custom control law in a program; each flight has a process of its own."""

    law: Literal["process"]
    """kind of control law"""
    command: tuple[_Word, ...] = Field(min_length=1)
    """program and its arguments"""
    files: Annotated[tuple[Path, ...], _Files] = _FILES
    protocol: Literal["binary", "json"] = "json"
    """records: lines of JSON, or 64-bit floats in the machine's byte order"""
    inputs: tuple[str, ...] = ()
    """values in a request: time, measured.NAME, reference.NAME or onboard.NAME; by default time
    and all measured quantities"""
    outputs: tuple[str, ...] = ("aileron", "rudder", "elevator", "equivalence_ratio")
    """values in a reply: fields of the command, or effectors of the vehicle"""
    time_limit: Annotated[Time, Field(gt=0.0)] = 60.0
    """limit on the elapsed time until a reply"""
    rate: Rate = _RATE
    period: ClassVar[int] = 0
    design: ClassVar[None] = None

    @model_validator(mode="after")
    def _check(self) -> "ProcessController":
        if not self.paths:
            raise Refusal(
                "'command' and 'files' name no file in the controller file's folder",
                "the program or script in 'files'",
                ("command",),
            )
        return self

    @property
    def paths(self) -> list[Path]:
        """Files of the control law; the first one is the program, if it is a declared file."""
        words = (word for word in self.command if isinstance(word, Path))
        return list(dict.fromkeys((*words, *self.files)))

    @property
    def file(self) -> Path:
        """File that error messages name."""
        return self.paths[0]

    @property
    def wired(self) -> dict[str, str]:
        """Source of each input by name."""
        return {name: name for name in self.inputs}


def parse_numbers(value: Any, keys: tuple[str | int, ...], unit: str | None) -> list[float]:
    """Convert a number or list of numbers to SI; ``unit``, if given, sets the dimension.

    Raise Refusal if a number is invalid.
    """
    items = value if isinstance(value, list) else [value]
    numbers = []
    for i, item in enumerate(items):
        with located(*keys, *([i] if isinstance(value, list) else [])):
            numbers.append(parse_any(item) if unit is None else parse_in_unit(item, unit))
    if not numbers:
        raise Refusal("found an empty list", "at least one number", keys)
    return numbers


# name and length of each setting; the length of a single number is 0
Layout = list[tuple[str, int]]
UserController = PythonController | CController | FmuController | ProcessController
USER_LAWS = ("python", "c", "fmu", "process")
PYTHON, *NATIVE = USER_LAWS
# keys of controller files whose values are paths relative to the file's folder
NAMING_KEYS = (
    "file",
    "library",
    "design",
    "sources",
    "around",
)


def find_files(law: UserController) -> dict[str, Path]:
    """Return all files of a control law, main file first, by path relative to a common folder.

    Raise Refusal if a file is missing.
    """
    if isinstance(law, CController):
        law_files = [law.library] if law.library is not None else list(law.sources)
    else:
        law_files = [law.file]
    further_files = (
        law.paths if isinstance(law, ProcessController) else expand(law_files[0].parent, law.files)
    )
    design = getattr(law, "design", None)
    paths = [
        Path(os.path.abspath(path))  # noqa: PTH100
        for path in (*law_files, *([design] if design is not None else []), *further_files)
    ]
    root = Path(os.path.commonpath([path.parent for path in paths]))
    return {path.relative_to(root).as_posix(): path for path in paths}
