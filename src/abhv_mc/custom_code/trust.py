"""Trust in custom code, based on a list of the hashes of code that the user has run.

The list is needed because a results folder may contain code of unknown origin.
"""

import os
from pathlib import Path

from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.input_error import InputError

_SIGNS = ("manifest.json", "campaign.yaml")  # files by which a results folder is recognized
_trusted_now: set[str] = set()  # hashes trusted explicitly in this process


def list_file() -> Path:
    """Return the path of the list of hashes. Raise OSError if there is no home folder."""
    try:
        base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    except RuntimeError as error:  # HOME is not set, and the system has no entry for the user.
        raise FileNotFoundError(str(error)) from None
    return Path(base, "abhv-mc", "flown_laws")


def is_trusted(source: UserSource) -> bool:
    """Return whether the user has run exactly this source before."""
    try:
        return source.hash in list_file().read_text(encoding="utf-8").split()
    except OSError:
        return False


def trust(source: UserSource) -> None:
    """Record that the user has run a source; if the list is not writable, only in memory."""
    if is_trusted(source):
        return
    try:
        file = list_file()
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with file.open("a", encoding="utf-8") as lines:
            lines.write(f"{source.hash}\n")
    except OSError:
        _trusted_now.add(source.hash)


def check_trusted(source: UserSource, trusted: bool = False) -> None:
    """Raise InputError for untrusted code unless the user trusts it explicitly."""
    if trusted:
        _trusted_now.add(source.hash)
    if source.hash not in _trusted_now and not is_trusted(source):
        problem = "you have not run this custom code before, and it would run with your permissions"
        raise InputError(
            source.file, problem, "the option --trust-code after an inspection of the code"
        )


def is_in_a_folder(file: Path) -> bool:
    """Return whether a file is in a results folder, directly or through a link."""
    parents = {
        parent for location in (file.absolute(), file.resolve()) for parent in location.parents
    }
    return any(all((parent / name).exists() for name in _SIGNS) for parent in parents)
