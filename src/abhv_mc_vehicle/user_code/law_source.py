"""Reading of custom code that a controller file names, without running the code."""

import json
from pathlib import Path
from typing import Any

from abhv_mc.custom_code.source import UserSource, check_trusted, is_in_a_folder, read_source
from abhv_mc.io.documents import Document
from abhv_mc.io.input_error import InputErrors, one_of
from abhv_mc.io.input_files import read_input
from abhv_mc.io.phrases import quoted
from abhv_mc_vehicle.control.law_file import (
    CController,
    FmuController,
    ProcessController,
    PythonController,
    UserController,
    find_files,
)
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.user_code.c_source import (
    describe_platform,
    find_compiler,
    interface,
    with_library,
)
from abhv_mc_vehicle.user_code.law_interface import COMMAND_FIELDS, Measured, onboard_fields

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
