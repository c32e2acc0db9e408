"""A law in C as a controller file names it: read, hashed with all that it is built from, and built by ``cc``."""

import functools
import hashlib
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from abhv_mc.control.law_file import CController, Layout
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.laws.columns import REFERENCE
from abhv_mc.kernel.numerics.lane_math import COS, HALF_PI, SIN
from abhv_mc.kernel.plant.vehicle import MAX_ACTUATORS
from abhv_mc.user_code.law_interface import COMMAND_FIELDS, Measured, Onboard, onboard_fields
from abhv_mc.user_code.source import UserSource
from abhv_mc.user_code.unpack import laws_folder, unpack

_HEADER = Path(__file__).with_name("abhv_law.h")
_ORIGIN = ["-Wl,-rpath,@loader_path" if sys.platform == "darwin" else "-Wl,-rpath,$ORIGIN"]
_LONGEST = 600.0  # s that cc may take
_ERROR = re.compile(
    r"(?m)^(?P<file>[^:\n]+):(?P<line>\d+):(?:(?P<column>\d+):)? (?:fatal )?error: (?P<words>.*)$"
)


def describe_platform() -> str:
    """What a library must have been built for to run here."""
    libc = "-".join(part for part in platform.libc_ver() if part)
    return f"{platform.system()} {platform.machine()} {libc}".strip()


@functools.cache
def find_compiler() -> str:
    """The C compiler ``cc`` and its version in words. Raises InputError where there is none."""
    try:
        told = subprocess.run(
            ["cc", "--version"],  # noqa: S607
            capture_output=True,
            text=True,
            timeout=60.0,
            check=True,
        )
    except (OSError, subprocess.SubprocessError) as error:
        found = f"no C compiler here ({error})"
        raise InputError(
            "cc", found, "the system's compiler, or 'library' in place of 'sources'"
        ) from None
    return told.stdout.splitlines()[0]


def make_header(onboard: bool = False) -> str:
    """The text of abhv_law.h for this version's measurements, reference and commands."""
    fields = {"MEASURED": Measured._fields, "REFERENCE": REFERENCE, "COMMAND": COMMAND_FIELDS}
    text = _HEADER.read_text(encoding="utf-8").replace("@INTERFACE@", interface(onboard))
    seen = "\n    abhv_onboard onboard;" if onboard else ""
    for mark, names in fields.items():
        lines = "\n".join(f"    double {name};" for name in names)
        text = text.replace(f"@{mark}@", lines + seen if mark == "MEASURED" else lines)
    text = text.replace("@MOST@", str(MAX_ACTUATORS)).replace(
        "@ONBOARD@", _struct(Onboard) if onboard else ""
    )
    for mark, numbers in {"SIN": SIN, "COS": COS, "HALF_PI": HALF_PI}.items():
        for i, number in enumerate(numbers):
            text = text.replace(f"@{mark}{i}@", repr(number))
    return text


def _struct(kind: Any) -> str:
    """A named tuple as a struct, after those that it holds."""
    inner = [
        hint for hint in dict.fromkeys(kind.__annotations__.values()) if hasattr(hint, "_fields")
    ]
    types = {hint: f"abhv_{hint.__name__.lower()}" for hint in inner}
    fields = "\n".join(
        f"    {types.get(hint, 'double')} {name};" for name, hint in kind.__annotations__.items()
    )
    return f"{''.join(map(_struct, inner))}typedef struct {{\n{fields}\n}} abhv_{kind.__name__.lower()};\n\n"


def interface(onboard: bool = False) -> str:
    """What a library must have been built with, as abhv_law.h says it."""
    groups = Measured._fields, REFERENCE, (*COMMAND_FIELDS, f"effectors[{MAX_ACTUATORS}]")
    names = ";".join(",".join(group) for group in groups) + (
        ";" + ",".join(onboard_fields()) if onboard else ""
    )
    return hashlib.sha256(names.encode()).hexdigest()[:16]


def make_settings_header(layout: Layout) -> str:
    """The text of abhv_settings.h: the struct of a controller file's settings, in their order."""
    fields = [f"    double {name}{f'[{length}]' if length else ''};" for name, length in layout]
    fields = fields or ["    double none; /* no settings */"]
    head = "/* The settings of the controller file, SI and radians; written from it. */\n"
    words = describe_layout(layout)
    return (
        f'{head}#define ABHV_SETTINGS "{words}"\n\ntypedef struct {{\n'
        + "\n".join(fields)
        + "\n} abhv_settings;\n"
    )


def describe_layout(layout: Layout) -> str:
    """The settings in words, as a library built with abhv_settings.h holds them."""
    return ", ".join(f"{name}[{length}]" if length else name for name, length in layout) or "none"


def with_library(source: UserSource) -> UserSource:
    """A law's source with the library built of it, once for each content. Raises InputError with cc's first error."""
    recipe = source.recipe
    if recipe is None or not recipe.get("sources"):
        return source
    kept = laws_folder() / f"built_{source.hash[:24]}.so"
    if not kept.is_file():
        with tempfile.TemporaryDirectory() as folder, atomic_write(kept) as built:
            shutil.copytree(unpack(source), folder, dirs_exist_ok=True)
            write_headers(Path(folder), recipe["settings"], recipe["onboard"])
            command = [
                "cc",
                "-shared",
                "-fPIC",
                *recipe["flags"],
                "-ffp-contract=off",
                "-I.",
                *_ORIGIN,
                "-o",
                built,
            ]
            command += [*recipe["sources"], "-lm"]
            try:
                told = subprocess.run(  # noqa: S603  the user's own flags
                    command,
                    cwd=folder,
                    capture_output=True,
                    text=True,
                    timeout=_LONGEST,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                raise InputError(
                    source.file, f"a build of more than {_LONGEST:g} s", "C code"
                ) from None
            if told.returncode:
                raise _explain(source, told.stderr)
    return replace(source, library=kept.read_bytes())


def _explain(source: UserSource, told: str) -> InputError:
    """The compiler's first error at the user's line."""
    root = Path(source.file.removesuffix(source.files[0][0]))
    match = _ERROR.search(told)
    if match is None:
        words = next(
            (line for line in told.splitlines() if "error" in line or "undefined" in line),
            told[-200:],
        )
        return InputError(
            source.file, f"what cc does not link ({words.strip():.300})", "C that links"
        )
    missing = re.match(r"([\w./-]+): No such file", match["words"])
    expected = f"files: [{missing[1]}] in its controller file" if missing else "C that cc compiles"
    column = int(match["column"]) if match["column"] else None
    return InputError(
        root / match["file"], f"'{match['words']:.300}'", expected, int(match["line"]), column
    )


def refuse_platform(source: UserSource) -> str | None:
    """Why a law's library cannot fly here, in words; None where it can."""
    recipe, here = source.recipe, describe_platform()
    if recipe is None or recipe["platform"] == here:
        return None
    return f"another platform ({here}) than the law's library is built for ({recipe['platform']})"


def write_headers(folder: Path, layout: Layout, onboard: bool) -> list[Path]:
    """Write abhv_law.h and abhv_settings.h, with which a law in C is built."""
    texts = {"abhv_law.h": make_header(onboard), "abhv_settings.h": make_settings_header(layout)}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


if __name__ == "__main__":
    from abhv_mc.control.controller_file import read_controller

    given = read_controller(sys.argv[1])
    if isinstance(given, CController):
        write_headers(Path(sys.argv[1]).parent, given.layout, given.onboard)
