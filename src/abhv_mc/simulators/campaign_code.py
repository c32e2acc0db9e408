"""Custom code of a campaign: its files, and whether the user may run it."""

from pathlib import Path

from abhv_mc.campaign.file.config import Campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.control.controller_file import Controller, read_controller
from abhv_mc.control.law_file import USER_LAWS, UserController
from abhv_mc.io.documents import read_document
from abhv_mc.user_code.law_source import law_place, read_law_source
from abhv_mc.user_code.source import UserSource, read_source
from abhv_mc.user_code.trust import check_trusted, is_in_a_folder
from abhv_mc.vehicle.file import read_vehicle_file


def check_user_code(campaign: Experiment, trusted: bool = False) -> list[UserSource]:
    """Return the campaign's custom code if the user may run it. Raise InputError otherwise.

    The user's own files may run, and copies in folders that the user has run before or declares
    ``trusted``. The code is not run here.
    """
    foreign, own = is_in_a_folder(campaign.document.path), []
    for file, source in campaign.simulator.find_code():
        if foreign or is_in_a_folder(file):
            check_trusted(source, trusted)
        else:
            own.append(source)
    return own


def find_code(model: Campaign) -> list[tuple[Path, UserSource]]:
    """Return files and code of a campaign's channels, control laws and vehicle."""
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
    """Raise InputError for a controller with untrusted code in a results folder."""
    if isinstance(controller, UserController) and is_in_a_folder(law_place(controller)):
        check_trusted(read_law_source(controller), trusted)
