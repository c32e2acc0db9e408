"""Function that reads the experiment of a results folder to re-run its flights."""

from collections.abc import Iterable
from dataclasses import replace

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.simulation import make_ready
from abhv_mc.folder.hashes import read_checked
from abhv_mc.folder.inputs import read_folder_campaign
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.folder.plan_file import find_stored_plans
from abhv_mc.folder.samples import SampleReader
from abhv_mc.io.documents import one_of
from abhv_mc.io.input_error import InputError


def open_flown(
    folder: CampaignFolder, controllers: Iterable[str], trusted: bool = False
) -> Experiment:
    """Check a results folder and return an experiment that can re-run the folder's flights.

    Raise InputError for an unknown controller, a damaged file or untrusted code.
    """
    read_checked(folder, [folder.campaign, folder.samples, *folder.input_files()])
    experiment = read_folder_campaign(folder)
    flown = list(read_manifest(folder.manifest).controllers)
    names = list(controllers)
    for name in names:
        if name not in flown:
            raise InputError(folder.root, f"unknown controller '{name}'", one_of(flown, name))
        read_checked(folder, [folder.plan(name)])
    plans = experiment.simulator.restore_plans(find_stored_plans(folder), names, trusted)
    return replace(make_ready(experiment, plans), columns=SampleReader(folder.samples).names)
