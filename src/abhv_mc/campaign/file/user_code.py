"""Custom code of a campaign: whether the user may run it."""

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.user_code.source import UserSource
from abhv_mc.user_code.trust import check_trusted, is_in_a_folder


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
