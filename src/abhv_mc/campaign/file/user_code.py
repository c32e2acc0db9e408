"""Permission check for the custom code of a campaign."""

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.custom_code.source import UserSource
from abhv_mc.custom_code.trust import check_trusted, is_in_a_folder


def check_user_code(campaign: Experiment, trusted: bool = False) -> list[UserSource]:
    """Return the custom code of a campaign. Raise InputError for untrusted code.

    Files outside results folders are trusted. A copy in a results folder is trusted if the user has
    run the same code before or sets ``trusted``. This function does not run any code.
    """
    foreign, own = is_in_a_folder(campaign.document.path), []
    for file, source in campaign.simulator.find_code():
        if foreign or is_in_a_folder(file):
            check_trusted(source, trusted)
        else:
            own.append(source)
    return own
