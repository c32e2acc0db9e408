"""Shipped packages, configurations and campaigns, in a checkout or an installed wheel."""

import os
from pathlib import Path

from abhv_mc.io.messages import InputError, one_of
from abhv_mc.version import ROOT

PACKAGES = (
    "abhv_mc",
    "abhv_mc_daveml",
    "abhv_mc_explore",
    "abhv_mc_fmu",
    "abhv_mc_gym",
    "abhv_mc_jsbsim",
    "abhv_mc_process",
    "abhv_mc_remote",
    "abhv_mc_tune",
    "abhv_mc_vehicle",
)
DEFAULT_VEHICLE = "abhv"  # default vehicle of flights, trims and margins


def shipped_folder() -> Path:
    """Return the folder that contains ``configs`` and ``campaigns``."""
    installed = ROOT / "abhv_mc/shipped_files"
    return installed if installed.is_dir() else ROOT.parent


def shipped_configs() -> Path:
    """Return the folder of the shipped vehicle, mission and control files."""
    return shipped_folder() / "configs"


def shipped_campaigns() -> Path:
    """Return the folder of the shipped campaign files."""
    return shipped_folder() / "campaigns"


def shipped_files(kind: str) -> dict[str, Path]:
    """Return the shipped files of one kind, by name.

    The kind is ``campaign``, ``vehicle``, ``mission`` or ``control``. Controllers designed for one
    vehicle are in a folder named after this vehicle.
    """
    folder = shipped_campaigns() if kind == "campaign" else shipped_configs() / kind
    folders = [folder]
    if kind == "control":
        folders += [folder / vehicle for vehicle in shipped_files("vehicle")]
    paths = [path for source in folders for path in source.glob("*.yaml")]
    return {path.stem: path for path in sorted(paths, key=lambda path: path.stem)}


def find_input(name: str | Path, *kinds: str) -> Path:
    """Return the path ``name``, or a shipped file of that name; earlier kinds have priority.

    For campaigns, the folder of ``abhv-mc new`` stands for its ``campaign.yaml``. Other folders are
    ignored, because the results folder of a shipped campaign may have its name. Raise
    :class:`abhv_mc.io.messages.InputError` for an unknown name.
    """
    text = str(name)
    study = f"{text}/campaign.yaml"
    is_results = os.access(f"{text}/manifest.json", os.F_OK)
    if "campaign" in kinds and os.access(study, os.R_OK) and not is_results:
        return Path(study)
    is_file = os.path.exists(text) and not os.path.isdir(text)  # noqa: PTH110, PTH112  methods of Path raise for long names
    if is_file or "/" in text or "\\" in text or text.endswith((".yaml", ".yml")):
        return Path(text)
    choices = [shipped_files(kind) for kind in kinds]
    for files in choices:
        if text in files:
            return files[text]
    names = sorted({shipped for files in choices for shipped in files})
    raise InputError(text, "no such file", f"a file, or {one_of(names, text)}")
