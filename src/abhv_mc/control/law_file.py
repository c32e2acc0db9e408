"""Controller files that name code of the user's own, and which files that code consists of."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from abhv_mc.io.documents import File, Refusal, StrictModel
from abhv_mc.io.units import Frequency

Rate = Annotated[Frequency, Field(gt=0.0)]
_RATE = "control ticks per second"
_FILES = "data and modules beside the law that it reads: names, patterns such as tables/*.csv, folders"


class PythonController(StrictModel):
    """A law of one's own, in a Python file."""

    law: Literal["python"] = Field(description="the control law")
    file: File = Field(description="the law, see abhv_mc.extend")
    files: tuple[str, ...] = Field((), description=_FILES)
    rate: Rate = Field(100.0, description=_RATE)
    settings: dict[str, Any] = Field({}, description="of the file's class Settings; with units where the file says so")

    @model_validator(mode="after")
    def _check(self) -> "PythonController":
        find_files(self)
        return self

    def warnings(self) -> list[str]:
        """Nothing that a file alone shows."""
        return []


UserController = PythonController
USER_LAWS = ("python",)
NAMING_KEYS = ("file",)  # of controller files: paths from the file's own folder


def find_files(law: UserController) -> dict[str, Path]:
    """Every file that a law consists of, by its name from the folder that holds them all; the law itself first.

    ``files`` lie beside the law. Raises Refusal for an entry
    that names none, or one that lies elsewhere.
    """
    paths = [Path(os.path.abspath(path)) for path in (law.file, *expand(law.file.parent, law.files))]  # noqa: PTH100
    root = Path(os.path.commonpath([path.parent for path in paths]))
    return {path.relative_to(root).as_posix(): path for path in paths}


def expand(folder: Path, patterns: Sequence[str]) -> list[Path]:
    """The files that entries of ``files`` name in a folder. Raises Refusal."""
    found: dict[Path, None] = {}
    for i, pattern in enumerate(patterns):
        parts = Path(pattern).parts
        if not parts or Path(pattern).is_absolute() or ".." in parts:
            raise Refusal(f"'{pattern}'", "a plain path to a file or folder beside the law", ("files", i))
        inside = "**/*" if (folder / pattern).is_dir() else ""
        paths = sorted((folder / pattern).glob(inside) if inside else folder.glob(pattern))
        files = [path for path in paths if path.is_file() and "__pycache__" not in path.parts]
        if not files:
            raise Refusal(f"'{pattern}', which names no file beside the law", "files beside the law", ("files", i))
        for path in files:
            if not path.resolve().is_relative_to(folder.resolve()):
                found_words = f"'{pattern}', which leads out of the law's folder to {path.resolve()}"
                raise Refusal(found_words, "a file beside the law", ("files", i))
            found[path] = None
    return list(found)


def find_law_files(document: Path, data: Any) -> list[Path]:
    """The files that a controller file with code of the user's own names beside ``file``; none of another document."""
    if not isinstance(data, dict) or data.get("law") not in USER_LAWS:
        return []
    entries = [data.get(key) for key in NAMING_KEYS]
    flat = [item for entry in entries for item in (entry if isinstance(entry, list) else [entry])]
    named = [document.parent / item for item in flat if isinstance(item, str)]
    patterns = [item for item in data.get("files") or [] if isinstance(item, str)]
    first = next((data.get(key) for key in ("file", "library", "sources") if data.get(key)), None)
    first = first[0] if isinstance(first, list) else first
    try:
        return named + (expand((document.parent / first).parent, patterns) if isinstance(first, str) else [])
    except Refusal:
        return named  # whoever reads it as a controller says so, with its place
