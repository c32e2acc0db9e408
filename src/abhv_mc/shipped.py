"""The configurations and campaigns that come with the program, from a checkout and from a wheel alike."""

from pathlib import Path

_PACKAGE = Path(__file__).parent


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
