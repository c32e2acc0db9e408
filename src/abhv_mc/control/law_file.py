"""Controller files that name code of the user's own, and which files that code consists of."""

import contextlib
import os
import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from abhv_mc.io.documents import File, Refusal, StrictModel, one_of
from abhv_mc.io.units import Frequency, parse_any, parse_in_unit, parse_unit
from abhv_mc.kernel.plant.vehicle import MAX_ACTUATORS

Rate = Annotated[Frequency, Field(gt=0.0)]
_RATE = "control ticks per second"
_PERIOD = (
    "control ticks after which the law does the same again, for margins: checked; 0 has them found"
)
_FILES = (
    "data and modules beside the law that it reads: names, patterns such as tables/*.csv, folders"
)
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class ControllerModel(StrictModel):
    """A controller file."""

    def warnings(self) -> list[str]:
        """Sentences on what the file alone shows."""
        return []


class PythonController(ControllerModel):
    """A user law in a Python file."""

    law: Literal["python"] = Field(description="the control law")
    file: File = Field(description="the law, see abhv_mc.extend")
    files: tuple[str, ...] = Field((), description=_FILES)
    rate: Rate = Field(100.0, description=_RATE)
    period: Annotated[int, Field(ge=0, le=100)] = Field(0, description=_PERIOD)
    settings: dict[str, Any] = Field(
        {}, description="of the file's class Settings; with units where the file says so"
    )
    commands: dict[str, Any] = Field(
        {},
        description="of the file's class Commands: a value, or values from times on, as {0 s: 100 m, 5 s: 130 m}",
    )
    around: File | None = Field(
        None,
        description="controller file of TLC or LQR whose measurement the file's function filters; its rate counts",
    )

    @model_validator(mode="after")
    def _check(self) -> "PythonController":
        for key in ("rate", "period", "commands"):
            if self.around is not None and key in self.model_fields_set:
                raise Refusal(f"'{key}' of a filter", "that of the controller around it", (key,))
        find_files(self)
        return self


class CController(ControllerModel):
    """A user law in C, by the interface of abhv_law.h."""

    law: Literal["c"] = Field(description="the control law")
    library: File | None = Field(None, description="the law as a shared library")
    sources: tuple[File, ...] = Field(
        (), description="the law's C sources, in place of a library: built by cc"
    )
    flags: tuple[str, ...] = Field(
        ("-O2",), description="what cc is given besides -ffp-contract=off"
    )
    design: File | None = Field(
        None, description="gains: a Python file with design(), or a CSV file over time"
    )
    files: tuple[str, ...] = Field((), description=_FILES)
    rate: Rate = Field(100.0, description=_RATE)
    period: Annotated[int, Field(ge=0, le=100)] = Field(0, description=_PERIOD)
    settings: dict[str, Any] = Field(
        {}, description="numbers or lists of numbers, with units: the struct abhv_settings"
    )
    units: dict[str, str] = Field(
        {},
        description="SI units of settings, as {bank_limit: rad}: these are refused without a unit, or in another",
    )
    effectors: tuple[str, ...] = Field(
        (),
        max_length=MAX_ACTUATORS,
        description="the vehicle's effectors that it commands, in their order in the struct",
    )
    onboard: bool = Field(
        False,
        description="whether measured->onboard is the nominal vehicle, as laws in Python see it",
    )

    @model_validator(mode="after")
    def _check(self) -> "CController":
        if (self.library is None) == (not self.sources):
            raise Refusal("both or none of the two", "library or sources")
        for name, unit in self.units.items():
            if name not in self.settings:
                raise Refusal(f"a unit of '{name}'", one_of(self.settings, name), ("units", name))
            with _placed("units", name):
                if parse_unit(unit)[0] != 1.0:
                    raise Refusal(
                        f"'{unit}'", "a unit of SI, in which the struct holds it, such as rad"
                    )
        for name, value in self.settings.items():
            if not _NAME.fullmatch(name):
                raise Refusal(f"the setting '{name}'", "a name that C allows", ("settings", name))
            parse_numbers(value, ("settings", name), self.units.get(name))
        find_files(self)
        return self

    @property
    def layout(self) -> "Layout":
        """Name and length of each setting, 0 for a number by itself, in the file's order."""
        return [
            (name, len(value) if isinstance(value, list) else 0)
            for name, value in self.settings.items()
        ]

    @property
    def numbers(self) -> list[float]:
        """The settings one after another, SI."""
        return [
            n
            for name, value in self.settings.items()
            for n in parse_numbers(value, (), self.units.get(name))
        ]


class FmuController(ControllerModel):
    """A user law as a Functional Mock-up Unit for co-simulation."""

    law: Literal["fmu"] = Field(description="the control law")
    file: File = Field(description="the FMU, of FMI 2.0 or 3.0")
    inputs: dict[str, bool | float | str] = Field(
        description="its inputs: measured.NAME, reference.NAME, onboard.NAME, gains.NAME or time; or a constant, "
        "such as true, 3 or 20 deg"
    )
    outputs: dict[str, str] = Field(
        description="the command's fields, such as elevator, or the vehicle's effectors, and the outputs that give them"
    )
    params: dict[str, Any] = Field(
        {}, description="start values of its parameters, with units where it has them"
    )
    design: File | None = Field(
        None, description="gains: a Python file with design(), or a CSV file over time"
    )
    files: tuple[str, ...] = Field((), description=_FILES)
    rate: Rate = Field(100.0, description=_RATE)
    period: Annotated[int, Field(ge=0, le=100)] = Field(0, description=_PERIOD)

    @model_validator(mode="after")
    def _check(self) -> "FmuController":
        for name, value in self.starts.items():
            with _placed("inputs" if name in self.constants else "params", name):
                parse_any(value)
        find_files(self)
        return self

    @property
    def wired(self) -> dict[str, str]:
        """The inputs that have a source."""
        return {
            name: source
            for name, source in self.inputs.items()
            if isinstance(source, str) and source[:1].isalpha()
        }

    @property
    def constants(self) -> tuple[str, ...]:
        """The inputs that keep a value."""
        return tuple(name for name in self.inputs if name not in self.wired)

    @property
    def starts(self) -> dict[str, Any]:
        """Start values of parameters and constant inputs; what is true is 1."""
        values = self.params | {name: self.inputs[name] for name in self.constants}
        return {
            name: float(value) if isinstance(value, bool) else value
            for name, value in values.items()
        }


def parse_numbers(value: Any, keys: tuple[str | int, ...], unit: str | None = None) -> list[float]:
    """A number or a list of them in SI, of the dimension of ``unit``, or of any or none. Raises Refusal."""
    items = value if isinstance(value, list) else [value]
    numbers = []
    for i, item in enumerate(items):
        with _placed(*keys, *([i] if isinstance(value, list) else [])):
            numbers.append(parse_any(item) if unit is None else parse_in_unit(item, unit))
    if not numbers:
        raise Refusal("an empty list", "at least one number", keys)
    return numbers


@contextlib.contextmanager
def _placed(*keys: str | int) -> Iterator[None]:
    """Refusals inside are about what stands at ``keys``."""
    try:
        yield
    except Refusal as refusal:
        raise Refusal(refusal.found, refusal.expected, keys) from None


Layout = list[tuple[str, int]]  # of settings: name and length, 0 for a number by itself
UserController = PythonController | CController | FmuController
USER_LAWS = ("python", "c", "fmu")
NAMING_KEYS = (
    "file",
    "library",
    "design",
    "sources",
    "around",
)  # of controller files: paths from the file's own folder


def find_files(law: UserController) -> dict[str, Path]:
    """Every file of a law, itself first, by its name from the folder that holds them all. Raises Refusal."""
    if isinstance(law, CController):
        named = [law.library] if law.library is not None else list(law.sources)
    else:
        named = [law.file]
    beside = expand(named[0].parent, law.files)
    design = getattr(law, "design", None)
    paths = [
        Path(os.path.abspath(path))  # noqa: PTH100
        for path in (*named, *([design] if design is not None else []), *beside)
    ]
    root = Path(os.path.commonpath([path.parent for path in paths]))
    return {path.relative_to(root).as_posix(): path for path in paths}


def expand(
    folder: Path, patterns: Sequence[str], empty_folders: Collection[str] = ()
) -> list[Path]:
    """Return the files that entries of ``files`` name in a folder. Raises Refusal."""
    found: dict[Path, None] = {}
    for i, pattern in enumerate(patterns):
        if pattern in empty_folders:
            continue
        parts = Path(pattern).parts
        if not parts or Path(pattern).is_absolute() or ".." in parts:
            raise Refusal(
                f"'{pattern}'", "a plain path to a file or folder beside it", ("files", i)
            )
        inside = "**/*" if (folder / pattern).is_dir() else ""
        paths = sorted((folder / pattern).glob(inside) if inside else folder.glob(pattern))
        files = [path for path in paths if path.is_file() and "__pycache__" not in path.parts]
        if not files:
            raise Refusal(
                f"'{pattern}', which names no file beside it", "files beside it", ("files", i)
            )
        for path in files:
            if not path.resolve().is_relative_to(folder.resolve()):
                found_words = f"'{pattern}', which leads out of its folder to {path.resolve()}"
                raise Refusal(found_words, "a file beside it", ("files", i))
            found[path] = None
    return list(found)
