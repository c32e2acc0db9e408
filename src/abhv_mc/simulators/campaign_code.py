"""A campaign's own code: which files it is in, and whether this user may run it."""

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
    """The campaign's own code, where this user may run it: his own, and those of a folder that he has flown.

    Not run here. Raises InputError for others, unless he says that he trusts them.
    """
    foreign, own = is_in_a_folder(campaign.document.path), []
    for file, source in campaign.simulator.find_code():
        if foreign or is_in_a_folder(file):
            check_trusted(source, trusted)
        else:
            own.append(source)
    return own


def find_code(model: Campaign) -> list[tuple[Path, UserSource]]:
    """The code of a campaign's channels, laws and vehicle, with the files that it is in."""
    code = [(model.channels, read_source(model.channels))] if model.channels is not None else []
    for path in model.controllers.values():
        data = read_document(path).data
        if isinstance(data, dict) and data.get("law") in USER_LAWS:
            controller = read_controller(path)
            if isinstance(controller, UserController):
                code.append((law_place(controller), read_law_source(controller)))
    vehicle = read_vehicle_file(model.vehicle).code
    if vehicle is not None:
        code += [(Path(one.file), UserSource(one.text, one.file)) for one in vehicle.functions()]
    return code


def check_user_law(controller: Controller, trusted: bool = False) -> None:
    """Raise InputError for a controller whose code is a folder's copy that this user has not flown, nor trusts."""
    if isinstance(controller, UserController) and is_in_a_folder(law_place(controller)):
        check_trusted(read_law_source(controller), trusted)
