"""Where a command may write: over nothing of a campaign's. Callbacks of the options that name an output."""

from pathlib import Path


def apart(path: Path | None) -> Path | None:
    """The path of an output. Raises InputError where it is, or lies in, what a campaign's folder holds of its own."""
    _refuse(path, taken=False)
    return path


def folder_apart(path: Path | None) -> Path | None:
    """The path of a folder to write files into: that of a campaign is refused, too, as their names may be taken."""
    _refuse(path, taken=True)
    return path


def _refuse(path: Path | None, taken: bool) -> None:
    if path is None or path == Path("-"):
        return
    from abhv_mc.io.input_error import InputError
    from abhv_mc.store.folder import find_own_place

    if path.exists() and not (path.is_file() or path.is_dir()):  # /dev/null would be renamed over
        raise InputError(path, None, None, "a pipe, socket or device", "the name of a file or folder")
    place = find_own_place(path)
    if place is not None and (taken or place != Path()):
        raise InputError(path, None, None, "a place of the campaign's own files", "another name, or a place elsewhere")
