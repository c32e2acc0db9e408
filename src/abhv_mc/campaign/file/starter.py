"""A folder to start one's own work from: the default campaign and every file that it needs."""

import shutil
from pathlib import Path

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.documents import InputError
from abhv_mc.shipped import shipped_campaigns, shipped_configs
from abhv_mc.vehicle.file import read_vehicle_file

_CAMPAIGN = "s_manoeuvre.yaml"


def write_starter(folder: Path) -> list[Path]:
    """Fill a new or empty folder, and name the files written; the campaign, ``campaign.yaml``, comes first.

    Raises :class:`InputError` where the folder holds something already.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, None, None, "a file", "a new or an empty folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(folder, None, None, "a folder that is not empty", "a new or an empty one")
    source = shipped_campaigns() / _CAMPAIGN
    campaign = read_campaign(source).model
    vehicle = read_vehicle_file(campaign.vehicle)
    files = {campaign.vehicle, campaign.mission, *campaign.controllers.values(), *vehicle.files}
    written = [folder / "campaign.yaml"]
    for file in sorted(path.resolve() for path in files):
        target = folder / file.relative_to(shipped_configs().resolve())
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
        written.append(target)
    written[0].write_text(source.read_text(encoding="utf-8").replace("../configs/", ""), encoding="utf-8")
    return written
