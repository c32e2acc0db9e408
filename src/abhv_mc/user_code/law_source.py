"""The code that a controller file names, read as it is and not run."""

from pathlib import Path
from typing import Any

from abhv_mc.control.law_file import CController, FmuController, UserController, find_files
from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.kernel.laws.columns import REFERENCE
from abhv_mc.user_code.c_source import describe_platform, find_name, read_c_source, read_native_source, with_library
from abhv_mc.user_code.law_interface import COMMAND_FIELDS, Measured, onboard_fields
from abhv_mc.user_code.source import UserSource, read_source
from abhv_mc.user_code.trust import check_trusted, is_in_a_folder

_NEEDED = COMMAND_FIELDS[:4]
_GROUPS = {"measured": Measured._fields, "reference": REFERENCE, "onboard": onboard_fields()}


def read_fmu_source(controller: FmuController) -> UserSource:
    """An FMU's file with what its inputs, outputs and parameters are wired to. Raises InputError."""
    _check_names(controller)
    paths = find_files(controller)
    recipe: dict[str, Any] = {
        "law": "fmu",
        "file": next(iter(paths)),
        "library": None,
        "inputs": controller.inputs,
        "outputs": controller.outputs,
        "effectors": [name for name in controller.outputs if name not in COMMAND_FIELDS],
        "params": controller.params,
        "platform": describe_platform(),
        "settings": [],
        "design": find_name(paths, controller.design),
    }
    return read_native_source(recipe, paths)


def _check_names(controller: FmuController) -> None:
    for name, source in controller.inputs.items():
        group, _, field = source.partition(".")
        known = source == "time" or (group == "gains" and bool(field)) or field in _GROUPS.get(group, ())
        if not known:
            choices = [f"{each}.{entry}" for each, entries in _GROUPS.items() for entry in entries]
            found = f"'{source}' for the input '{name}'"
            raise InputError(controller.file, found, one_of([*choices, "gains.NAME", "time"], source))
    missing = [name for name in _NEEDED if name not in controller.outputs]
    if missing:
        raise InputError(controller.file, f"no output for {', '.join(missing)}", "all four controls")


def law_place(controller: UserController) -> Path:
    """The file that is the law, beside which its other files lie."""
    if isinstance(controller, CController):
        return controller.library or controller.sources[0]
    return controller.file


def read_law_source(controller: UserController) -> UserSource:
    """A controller's code with the files that it declares. Raises InputError."""
    if isinstance(controller, CController):
        return read_c_source(controller)
    if isinstance(controller, FmuController):
        return read_fmu_source(controller)
    return read_source(law_place(controller), find_files(controller))


def read_trusted_law(controller: UserController) -> UserSource:
    """A controller's code that is to be run. Raises InputError for a folder's copy that its user has not flown."""
    source = read_law_source(controller)
    if is_in_a_folder(law_place(controller)):
        check_trusted(source)
    return with_library(source)
