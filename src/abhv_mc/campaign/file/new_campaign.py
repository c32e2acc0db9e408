"""A folder to start one's own work from: the default campaign and every file that it needs."""

import shutil
from pathlib import Path

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.documents import InputError
from abhv_mc.shipped import shipped_campaigns, shipped_configs
from abhv_mc.vehicle.file import read_vehicle_file

_CAMPAIGN = "s_manoeuvre.yaml"
_LAW = "cascade"


def write_new_campaign(folder: Path, law: bool = False) -> list[Path]:
    """Fill a new or empty folder, and name the files written; the campaign, ``campaign.yaml``, comes first.

    ``law`` adds a commented controller of one's own, the first of the campaign.
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
    if law:
        written += _add_law(folder, written[0])
    return written


def _add_law(folder: Path, campaign: Path) -> list[Path]:
    """The shipped example of a controller of one's own, by the name ``my_law``."""
    source, target = shipped_configs() / "control", folder / "control"
    files = [target / "my_law.py", target / "my_law.yaml"]
    shutil.copyfile(source / f"{_LAW}.py", files[0])
    text = (source / f"{_LAW}.yaml").read_text(encoding="utf-8").replace(f"{_LAW}.py", files[0].name)
    files[1].write_text(text, encoding="utf-8")
    text = campaign.read_text(encoding="utf-8")
    first = "  tlc: control/tlc.yaml\n"
    mine = "  my_law: control/my_law.yaml # your own: control/my_law.py\n"
    campaign.write_text(text.replace(first, mine + first), encoding="utf-8")
    return files
