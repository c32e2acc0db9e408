"""Which code of others may run: the user's own list of the laws that he has flown, by hash.

A file in a campaign's folder is nobody's own: it may come from anywhere.
"""

import os
from pathlib import Path

from abhv_mc.io.input_error import InputError
from abhv_mc.user_code.source import UserSource

_SIGNS = ("manifest.json", "campaign.yaml")  # a campaign's folder holds both
_trusted_now: set[str] = set()  # hashes of what the user of this process says that he trusts


def list_file() -> Path:
    """Return the list's path in the user's configuration. Raise OSError if the user has no home folder."""
    try:
        base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    except RuntimeError as error:  # no HOME, and the system does not know the user
        raise FileNotFoundError(str(error)) from None
    return Path(base, "abhv-mc", "flown_laws")


def is_trusted(source: UserSource) -> bool:
    """Whether this user has flown exactly this text."""
    try:
        return source.hash in list_file().read_text(encoding="utf-8").split()
    except OSError:
        return False


def trust(source: UserSource) -> None:
    """Remember that this user has flown it: for this process alone where his configuration cannot be written."""
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
    """Raise InputError for code that this user has not flown, unless he says that he trusts it."""
    if trusted:
        _trusted_now.add(source.hash)
    if source.hash not in _trusted_now and not is_trusted(source):
        found = "Python code that you have not flown from a file of your own: it would run with your rights"
        raise InputError(source.file, found, "a look at it, then --trust-code")


def is_in_a_folder(file: Path) -> bool:
    """Whether a file is in a campaign's folder, or is named from within one: by a link, or by a path that leads out."""
    parents = {parent for place in (file.absolute(), file.resolve()) for parent in place.parents}
    return any(all((parent / name).exists() for name in _SIGNS) for parent in parents)
