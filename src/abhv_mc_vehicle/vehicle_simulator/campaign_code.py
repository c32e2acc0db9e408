"""Access to the custom code of a campaign: channels, control laws and vehicle functions."""

from pathlib import Path
from typing import Any

from abhv_mc.custom_code.source import UserSource, check_trusted, is_in_a_folder, read_source
from abhv_mc.io.documents import read_document
from abhv_mc_vehicle.control.controller_file import Controller, read_controller
from abhv_mc_vehicle.control.law_file import USER_LAWS, UserController
from abhv_mc_vehicle.user_code.law_source import law_place, read_law_source
from abhv_mc_vehicle.vehicle.file import read_vehicle_file


def find_code(model: Any) -> list[tuple[Path, UserSource]]:
    """Return the files and code of the channels, control laws and vehicle."""
    code = [(model.channels, read_source(model.channels))] if model.channels is not None else []
    for path in model.controllers.values():
        data = read_document(path).data
        if isinstance(data, dict) and data.get("law") in USER_LAWS:
            controller = read_controller(path)
            if isinstance(controller, UserController):
                code.append((law_place(controller), read_law_source(controller)))
    vehicle = read_vehicle_file(model.vehicle).code
    if vehicle is not None:
        code += [
            (Path(function.file), UserSource(function.text, function.file))
            for function in vehicle.functions()
        ]
    return code


def check_user_law(controller: Controller, trusted: bool = False) -> None:
    """Raise InputError if a controller in a results folder has untrusted code."""
    if isinstance(controller, UserController) and is_in_a_folder(law_place(controller)):
        check_trusted(read_law_source(controller), trusted)
