"""A law as an FMU, as a controller file names it: read and hashed with what is wired to it, not unpacked or run."""

from typing import Any

from abhv_mc.control.law_file import FmuController, find_files
from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.kernel.laws.columns import REFERENCE
from abhv_mc.user_code.c_source import describe_platform, find_name, read_native_source
from abhv_mc.user_code.law_interface import COMMAND_FIELDS, Measured, onboard_fields
from abhv_mc.user_code.source import UserSource

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
