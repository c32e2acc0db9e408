"""Which code of others may run: the user's own list of the laws that he has flown, by hash."""

import os
from pathlib import Path

from abhv_mc.io.input_error import InputError
from abhv_mc.own.source import OwnSource


def list_file() -> Path:
    """The list, in the user's own configuration."""
    base = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    return base / "abhv-mc" / "flown_laws"


def is_trusted(source: OwnSource) -> bool:
    """Whether this user has flown exactly this text."""
    try:
        return source.hash in list_file().read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError):
        return False


def trust(source: OwnSource) -> None:
    """Remember that this user has flown it; nothing where his configuration cannot be written."""
    if not is_trusted(source):
        try:
            list_file().parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with list_file().open("a", encoding="utf-8") as file:
                file.write(f"{source.hash}\n")
        except OSError:
            pass


def check_trusted(source: OwnSource, trusted: bool) -> None:
    """Raise InputError for code that this user has not flown, unless he says that he trusts it."""
    if not trusted and not is_trusted(source):
        found = "Python code that you have not flown from a file of your own: it would run with your rights"
        raise InputError(source.file, None, None, found, "a look at it, then --trust-code")
