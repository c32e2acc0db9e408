"""Where a command may write, judged before it does anything else. Callbacks of the options that name an output."""

import os
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import Any, get_args, get_type_hints

_OWN, _ELSEWHERE = "a place of the campaign's own files", "another name, or a place elsewhere"


def new_file(path: Path | None) -> Path | None:
    """The path of a file to write. Raises InputError, as all of these, where it is, or lies in, a campaign's own."""
    if path == Path("-"):  # bench prints there
        return path
    return _refuse(path, folder=False)


def new_folder(path: Path | None) -> Path | None:
    """The path of a folder to write files into: that of a campaign is refused, too, as their names may be taken."""
    return _refuse(path, folder=True)


def campaign_folder(path: Path | None) -> Path | None:
    """The path of the folder that a campaign flies in, or is to fly in."""
    return _refuse(path, folder=True, campaign=True)


def campaign_folder_or_address(path: Path | None) -> Path | None:
    """The same, or an address such as s3://bucket/folder."""
    return path if path is not None and _is_address(path) and len(path.parts) > 1 else campaign_folder(path)


def _is_address(path: Path) -> bool:
    if ":" not in str(path):
        return False
    from abhv_mc.folder.remote import parse_address

    return parse_address(f"{path}/") is not None  # of s3:// a path keeps s3:


def _refuse(path: Path | None, folder: bool, campaign: bool = False) -> Path | None:
    if path is None:
        return None
    from abhv_mc.folder.layout import find_own_place
    from abhv_mc.io.input_error import InputError

    wanted = "the name of a folder" if folder else "the name of a file"
    if _is_address(path):
        raise InputError(path, None, None, "an address", wanted)
    if str(path).startswith("~"):  # in quotes, or after '=': no shell has made a home folder of it
        raise InputError(path, None, None, "a name that begins with '~'", "the path written out")
    place = find_own_place(path)
    if place is not None and not (campaign and place == Path()):
        raise InputError(path, None, None, _OWN, _ELSEWHERE)
    if path.exists() and not (path.is_file() or path.is_dir()):  # /dev/null would be renamed over
        raise InputError(path, None, None, "a pipe, socket or device", wanted)
    if path.is_file() if folder else path.is_dir() or path.name in ("", ".."):
        raise InputError(path, None, None, "a file" if folder else "a folder", wanted)
    whole = path.absolute()
    home = next(place for place in ((whole,) if folder else ()) + tuple(whole.parents) if place.exists())
    if not home.is_dir():
        raise InputError(path, None, None, f"a place below a file, {home}", wanted)
    if not os.access(home, os.W_OK | os.X_OK):
        found = f"a place in {home}, which cannot be written"
        raise InputError(path, None, None, found, "a folder that can be written")
    return path


def with_outputs_apart(command: Callable[..., None]) -> Callable[..., None]:
    """The command, which looks at its outputs together once all its words are read."""

    @wraps(command)
    def checked(**given: Any) -> None:
        callbacks = {
            name: callback
            for name, hint in get_type_hints(command, include_extras=True).items()
            for callback in (getattr(info, "callback", None) for info in get_args(hint)[1:])
            if callback in (new_file, new_folder, campaign_folder, campaign_folder_or_address)
        }
        campaigns = [given[name] for name, callback in callbacks.items() if callback is campaign_folder]
        keep_apart(
            [given[name] for name in callbacks],
            [value for name, value in given.items() if name not in callbacks and isinstance(value, str | Path)],
            campaigns,
        )
        command(**given)

    return checked


def keep_apart(
    outputs: Iterable[Path | None], inputs: Iterable[str | Path] = (), campaigns: Iterable[Path | None] = ()
) -> None:
    """Raises InputError where an output is another one, a file that is read, or a part of a campaign to be flown."""
    from abhv_mc.folder.layout import is_own_part
    from abhv_mc.io.input_error import InputError

    # Words may be no paths at all, which Path.is_file would raise for.
    taken = [os.path.realpath(path) for path in inputs if os.path.isfile(path)]  # noqa: PTH113
    roots = [Path(os.path.realpath(root)) for root in campaigns if root is not None]
    for path in outputs:
        if path is None or path == Path("-"):
            continue
        place = os.path.realpath(path)
        if place in taken:
            raise InputError(path, None, None, "a file that the command reads or writes, too", "another name")
        if any(is_own_part(root, Path(place)) for root in roots):
            raise InputError(path, None, None, _OWN, _ELSEWHERE)
        taken.append(place)
