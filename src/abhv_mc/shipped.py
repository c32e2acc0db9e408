"""What comes with the program, from a checkout and from a wheel alike: packages, configurations and campaigns."""

import os
from pathlib import Path

from abhv_mc.io.input_error import InputError, one_of

PACKAGES = ("abhv_mc", "abhv_mc_daveml", "abhv_mc_explore", "abhv_mc_verification")  # side by side
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
    """The shipped files of a kind by name: ``campaign``, ``vehicle``, ``mission`` or ``control``."""
    folder = shipped_campaigns() if kind == "campaign" else shipped_configs() / kind
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def find_input(name: str | Path, *kinds: str) -> Path:
    """The file that is meant: a path, or the name of a shipped one of these kinds, the first kind that has it.

    Raises :class:`abhv_mc.io.input_error.InputError` for a name that none has.
    """
    text = str(name)
    there = os.path.exists(text)  # noqa: PTH110  Path's raises where the name is too long
    if there or "/" in text or "\\" in text or text.endswith((".yaml", ".yml")):
        return Path(text)
    known = [shipped_files(kind) for kind in kinds]
    for files in known:
        if text in files:
            return files[text]
    names = sorted({shipped for files in known for shipped in files})
    raise InputError(text, "no such file", f"a file, or {one_of(names, text)}")
