"""Trust in custom code: the user's list of control laws that he has run, by hash.

Files in a campaign's folder may come from anywhere.
"""

import os
from pathlib import Path

from abhv_mc.io.input_error import InputError
from abhv_mc.user_code.source import UserSource

_SIGNS = ("manifest.json", "campaign.yaml")  # a campaign's folder holds both
_trusted_now: set[str] = set()  # hashes that the user of this process trusts explicitly


def list_file() -> Path:
    """Return the path of the list. Raise OSError if the user has no home folder."""
    try:
        base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    except RuntimeError as error:  # no HOME, and the system does not know the user
        raise FileNotFoundError(str(error)) from None
    return Path(base, "abhv-mc", "flown_laws")


def is_trusted(source: UserSource) -> bool:
    """Return whether this user has run exactly this text."""
    try:
        return source.hash in list_file().read_text(encoding="utf-8").split()
    except OSError:
        return False


def trust(source: UserSource) -> None:
    """Record that this user has run a source, in this process only if not writable."""
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
        problem = (
            "Python code that you have not flown from a file of your own: it would run with your "
            "rights"
        )
        raise InputError(source.file, problem, "a look at it, then --trust-code")


def is_in_a_folder(file: Path) -> bool:
    """Return whether a file is in a campaign's folder, directly or through a link."""
    parents = {
        parent for location in (file.absolute(), file.resolve()) for parent in location.parents
    }
    return any(all((parent / name).exists() for name in _SIGNS) for parent in parents)
