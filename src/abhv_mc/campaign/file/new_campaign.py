"""A folder to start one's own work from: the default campaign and every file that it needs."""

import json
import os
import shutil
from pathlib import Path

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.inputs import MODELS, find_kind
from abhv_mc.campaign.file.schema import make_schema
from abhv_mc.io.documents import InputError
from abhv_mc.shipped import shipped_campaigns, shipped_configs
from abhv_mc.vehicle.file import read_vehicle_file

_CAMPAIGN = "s_manoeuvre.yaml"
_SCHEMAS = "schemas"


def write_new_campaign(folder: Path) -> list[Path]:
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
    return written + _write_schemas(folder, [file for file in written if file.suffix == ".yaml"])


def _write_schemas(folder: Path, files: list[Path]) -> list[Path]:
    """Write the schemas, and begin each of the YAML files with the line by which editors find its own."""
    written = []
    (folder / _SCHEMAS).mkdir()
    for kind in MODELS:
        written.append(folder / _SCHEMAS / f"{kind}.schema.json")
        written[-1].write_text(json.dumps(make_schema(kind), indent=1) + "\n", encoding="utf-8")
    for file in files:
        schema = Path(os.path.relpath(folder / _SCHEMAS / f"{find_kind(file)}.schema.json", file.parent))
        line = f"# yaml-language-server: $schema={schema.as_posix()}\n"
        file.write_text(line + file.read_text(encoding="utf-8"), encoding="utf-8")
    return written
