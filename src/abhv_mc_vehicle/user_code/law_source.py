"""Reading of custom code that a controller file names; sources and builds of laws in C.

Reading does not run the code. Laws in C are hashed with all dependencies and built with ``cc``.
"""

import functools
import hashlib
import json
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from abhv_mc.custom_code.source import UserSource, check_trusted, is_in_a_folder, read_source
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.documents import Document
from abhv_mc.io.input_files import read_input
from abhv_mc.io.messages import InputError, InputErrors, one_of, quoted
from abhv_mc_vehicle.control.law_file import (
    CController,
    FmuController,
    Layout,
    ProcessController,
    PythonController,
    UserController,
    find_files,
)
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.numerics.lane_math import COS, HALF_PI, SIN
from abhv_mc_vehicle.kernel.plant.vehicle import MAX_ACTUATORS
from abhv_mc_vehicle.user_code.law_interface import (
    COMMAND_FIELDS,
    Measured,
    Onboard,
    onboard_fields,
)
from abhv_mc_vehicle.user_code.unpack import laws_folder, unpack

_HEADER = Path(__file__).with_name("abhv_law.h")
_ORIGIN = ["-Wl,-rpath,@loader_path" if sys.platform == "darwin" else "-Wl,-rpath,$ORIGIN"]
_LONGEST = 600.0  # time limit for cc, s
_ERROR = re.compile(
    r"(?m)^(?P<file>[^:\n]+):(?P<line>\d+):(?:(?P<column>\d+):)? (?:fatal )?error: (?P<words>.*)$"
)


def describe_platform() -> str:
    """Return the platform for which a library must have been built."""
    libc = "-".join(item for item in platform.libc_ver() if item)
    return f"{platform.system()} {platform.machine()} {libc}".strip()


@functools.cache
def find_compiler() -> str:
    """Return the version of the C compiler ``cc``. Raise InputError if ``cc`` is missing."""
    try:
        completed = subprocess.run(
            ["cc", "--version"],  # noqa: S607
            capture_output=True,
            text=True,
            timeout=60.0,
            check=True,
        )
    except (OSError, subprocess.SubprocessError) as error:
        raise InputError(
            "cc",
            f"no C compiler is installed ({error})",
            "a C compiler, or 'library' instead of 'sources'",
        ) from None
    return completed.stdout.splitlines()[0]


def make_header(onboard: bool = False) -> str:
    """Return the text of abhv_law.h for the current measurements, reference and commands."""
    fields = {"MEASURED": Measured._fields, "REFERENCE": REFERENCE, "COMMAND": COMMAND_FIELDS}
    text = _HEADER.read_text("utf-8").replace("@INTERFACE@", interface(onboard))
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
    """Return the C struct for a named tuple, preceded by the structs of its fields."""
    inner = [
        hint for hint in dict.fromkeys(kind.__annotations__.values()) if hasattr(hint, "_fields")
    ]
    types = {hint: f"abhv_{hint.__name__.lower()}" for hint in inner}
    fields = "\n".join(
        f"    {types.get(hint, 'double')} {name};" for name, hint in kind.__annotations__.items()
    )
    return (
        f"{''.join(map(_struct, inner))}typedef struct {{\n{fields}\n}} "
        f"abhv_{kind.__name__.lower()};\n\n"
    )


def interface(onboard: bool) -> str:
    """Return the interface ID in abhv_law.h, which a library must contain."""
    groups = Measured._fields, REFERENCE, (*COMMAND_FIELDS, f"effectors[{MAX_ACTUATORS}]")
    names = ";".join(",".join(group) for group in groups) + (
        ";" + ",".join(onboard_fields()) if onboard else ""
    )
    return hashlib.sha256(names.encode()).hexdigest()[:16]


def make_settings_header(layout: Layout) -> str:
    """Return the text of abhv_settings.h, with a struct of the controller's settings."""
    fields = [f"    double {name}{f'[{length}]' if length else ''};" for name, length in layout]
    fields = fields or ["    double none; /* no settings */"]
    head = "/* Settings of the controller file, SI and radians; generated from the file. */\n"
    description = describe_layout(layout)
    return (
        f'{head}#define ABHV_SETTINGS "{description}"\n\ntypedef struct {{\n'
        + "\n".join(fields)
        + "\n} abhv_settings;\n"
    )


def describe_layout(layout: Layout) -> str:
    """Return a description of the layout of the settings.

    Libraries that are built with abhv_settings.h contain this text.
    """
    return ", ".join(f"{name}[{length}]" if length else name for name, length in layout) or "none"


def with_library(source: UserSource) -> UserSource:
    """Return a control law's source with its library, which is built once per version.

    Raise InputError with the first error of the C compiler.
    """
    recipe = source.recipe
    if recipe is None or not recipe.get("sources"):
        return source
    library = laws_folder() / f"built_{source.hash[:24]}.so"
    if not library.is_file():
        with tempfile.TemporaryDirectory() as folder, atomic_write(library) as built:
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
                completed = subprocess.run(  # noqa: S603  the user's own flags
                    command,
                    cwd=folder,
                    capture_output=True,
                    text=True,
                    timeout=_LONGEST,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                raise InputError(
                    source.file, f"the build takes longer than {_LONGEST:g} s", "a faster build"
                ) from None
            if completed.returncode:
                raise _explain(source, completed.stderr)
    return replace(source, library=library.read_bytes())


def _explain(source: UserSource, output: str) -> InputError:
    """Return the compiler's first error as an InputError at the user's line."""
    root = Path(source.file.removesuffix(source.files[0][0]))
    match = _ERROR.search(output)
    if match is None:
        message = next(
            (line for line in output.splitlines() if "error" in line or "undefined" in line),
            output[-200:],
        )
        return InputError(
            source.file,
            f"the law cannot be linked ({message.strip():.300})",
            "C code that can be linked",
        )
    missing = re.match(r"([\w./-]+): No such file", match["words"])
    expected = (
        f"'files: [{missing[1]}]' in the controller file" if missing else "C code that compiles"
    )
    column = int(match["column"]) if match["column"] else None
    return InputError(
        root / match["file"],
        f"the code does not compile ({match['words']:.300})",
        expected,
        int(match["line"]),
        column,
    )


def refuse_platform(source: UserSource) -> str | None:
    """Return the reason why a law's library cannot run on this machine, or None."""
    recipe = source.recipe
    current = describe_platform()
    if recipe is None or recipe["platform"] == current:
        return None
    return f"the library of the law was not built for {current}, but for {recipe['platform']}"


def write_headers(folder: Path, layout: Layout, onboard: bool) -> list[Path]:
    """Write the headers abhv_law.h and abhv_settings.h for a control law in C."""
    texts = {"abhv_law.h": make_header(onboard), "abhv_settings.h": make_settings_header(layout)}
    for name, text in texts.items():
        (folder / name).write_text(text, "utf-8")
    return [folder / name for name in texts]


_NEEDED = COMMAND_FIELDS[:4]
_ALL_INPUTS = ("time", *(f"measured.{name}" for name in Measured._fields))
_GROUPS = {"measured": Measured._fields, "reference": REFERENCE, "onboard": onboard_fields()}


def law_place(controller: UserController) -> Path:
    """Return the path of the control law that a controller file names.

    The path may lead outside the folder of the controller file.
    """
    # Not the paths of find_files, which are without '..' and may lie outside a results folder.
    if isinstance(controller, CController):
        return controller.library or controller.sources[0]
    return controller.file


def read_law_source(controller: UserController) -> UserSource:
    """Return the code and declared files of a controller, without building the code.

    For a law in C or an FMU, the text in the result describes the build, the platform and the
    wiring. Raise InputError if a file is invalid.
    """
    paths = find_files(controller)
    if isinstance(controller, PythonController):
        return read_source(controller.file, paths)
    names = list(paths)
    recipe: dict[str, Any]
    if isinstance(controller, CController):
        recipe = {
            "law": "c",
            "library": names[0] if controller.library is not None else None,
            "sources": names[: len(controller.sources)],
            "flags": list(controller.flags),
            "compiler": find_compiler() if controller.sources else None,
            "interface": interface(controller.onboard),
            "onboard": controller.onboard,
            "effectors": controller.effectors,
            "platform": describe_platform(),
            "settings": controller.layout,
        }
    else:
        recipe = {
            "law": controller.law,
            "library": None,
            "inputs": controller.wired,
            "outputs": controller.outputs,
            "effectors": [name for name in controller.outputs if name not in COMMAND_FIELDS],
            "platform": describe_platform(),
            "settings": [],
        }
        if isinstance(controller, FmuController):
            recipe |= {
                "file": names[0],
                "params": controller.starts,
                "constants": controller.constants,
            }
        else:
            recipe |= {
                "command": [
                    names[controller.paths.index(word)] if isinstance(word, Path) else word
                    for word in controller.command
                ],
                "inputs": controller.wired or {name: name for name in _ALL_INPUTS},
                "protocol": controller.protocol,
                "time_limit": controller.time_limit,
            }
    design = controller.design
    recipe["design"] = next(
        (name for name, path in paths.items() if design and path.samefile(design)), None
    )
    files = tuple((name, read_input(path)) for name, path in paths.items())
    return UserSource(json.dumps(recipe), str(paths[names[0]]), files)


def check_wiring(document: Document, controller: FmuController | ProcessController) -> None:
    """Raise InputErrors for unknown input sources and missing outputs."""
    errors = []
    for name, source in controller.wired.items():
        group, _, field = source.partition(".")
        is_known = (
            source == "time"
            or (group == "gains" and bool(field))
            or field in _GROUPS.get(group, ())
        )
        if not is_known:
            choices = [
                f"{group_name}.{entry}"
                for group_name, entries in _GROUPS.items()
                for entry in entries
            ]
            problem = f"unknown source '{source}' for the input '{name}'"
            expected = one_of([*choices, "gains.NAME", "time"], source)
            errors.append(document.error(("inputs", name), problem, expected))
    missing = [name for name in _NEEDED if name not in controller.outputs]
    if missing:
        problem = f"no output is assigned to {quoted(missing, 'or')}"
        errors.append(document.key_error(("outputs",), problem, "outputs for all four controls"))
    if errors:
        raise InputErrors(errors)


def read_trusted_law(controller: UserController) -> UserSource:
    """Return the code of a controller. Raise InputError for an untrusted copy."""
    source = read_law_source(controller)
    if is_in_a_folder(law_place(controller)):
        check_trusted(source)
    return with_library(source)


if __name__ == "__main__":
    from abhv_mc_vehicle.control.controller_file import read_controller

    controller_file = read_controller(sys.argv[1])
    if isinstance(controller_file, CController):
        write_headers(Path(sys.argv[1]).parent, controller_file.layout, controller_file.onboard)
