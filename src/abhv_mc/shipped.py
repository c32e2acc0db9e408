"""What comes with the program, from a checkout and from a wheel alike: packages, configurations and campaigns."""

import os
from pathlib import Path

from abhv_mc.io.input_error import InputError, one_of

PACKAGES = (  # side by side
    "abhv_mc",
    "abhv_mc_daveml",
    "abhv_mc_explore",
    "abhv_mc_fmu",
    "abhv_mc_jsbsim",
    "abhv_mc_remote",
    "abhv_mc_tune",
    "abhv_mc_verification",
)
_PACKAGE = Path(__file__).parent
DEFAULT_VEHICLE = "abhv"  # of a flight, trim or margins that name none


def shipped_folder() -> Path:
    """The folder that holds ``configs`` and ``campaigns``: inside the wheel, or the checkout's root."""
    installed = _PACKAGE / "shipped_files"
    return installed if installed.is_dir() else _PACKAGE.parents[1]


def shipped_configs() -> Path:
    """The folder of the vehicle, mission and control files."""
    return shipped_folder() / "configs"


def shipped_campaigns() -> Path:
    """The folder of the campaign files."""
    return shipped_folder() / "campaigns"


def shipped_files(kind: str) -> dict[str, Path]:
    """Return the shipped files of a kind by name: ``campaign``, ``vehicle``, ``mission`` or ``control``.

    Controllers made for one vehicle are in a folder with its name.
    """
    folder = shipped_campaigns() if kind == "campaign" else shipped_configs() / kind
    folders = [folder]
    if kind == "control":
        folders += [folder / vehicle for vehicle in shipped_files("vehicle")]
    paths = [path for each in folders for path in each.glob("*.yaml")]
    return {path.stem: path for path in sorted(paths, key=lambda path: path.stem)}


def find_input(name: str | Path, *kinds: str) -> Path:
    """The file that is meant: a path, or the name of a shipped one of these kinds, the first kind that has it.

    A folder is no input: a campaign's results may have the name of the shipped campaign.

    Raises :class:`abhv_mc.io.input_error.InputError` for a name that none has.
    """
    text = str(name)
    is_file = os.path.exists(text) and not os.path.isdir(text)  # noqa: PTH110, PTH112  Path's raise for long names
    if is_file or "/" in text or "\\" in text or text.endswith((".yaml", ".yml")):
        return Path(text)
    known = [shipped_files(kind) for kind in kinds]
    for files in known:
        if text in files:
            return files[text]
    names = sorted({shipped for files in known for shipped in files})
    raise InputError(text, "no such file", f"a file, or {one_of(names, text)}")
