"""Where a command may write, judged before it does anything else: callbacks of the options that name an output."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from abhv_mc.io.address import read_address
from abhv_mc.io.input_error import InputError

_INPUTS = (".yaml", ".yml", ".py", ".csv", ".parquet")


def output(
    judge: Callable[[Path | None], Path | None],
    metavar: str,
    words: str,
    default: str | bool = True,
) -> Any:
    """The option ``--output`` of a command; ``default``: where it writes without, in words."""
    return typer.Option(
        "--output", "-o", callback=judge, metavar=metavar, help=words, show_default=default
    )


def output_file(path: Path | None) -> Path | None:
    """The path of a file to write. Raises InputError, as all of these."""
    if path is None:
        return None
    if (
        path.exists() and not path.is_file()
    ):  # root's --json /dev/null would be renamed over the device
        raise InputError(path, "a folder or a device", "the name of a file")
    return _check(path, path.absolute().parent)


def output_file_or_stream(path: Path | None) -> Path | None:
    """The same, or ``-`` for standard output."""
    return path if path == Path("-") else output_file(path)


def json_file(path: Path | None) -> Path | None:
    """The same for figures, never in the place of an input file: two arguments are easily swapped."""
    if path is not None and path.suffix in _INPUTS and path.exists():
        raise InputError(path, f"a {path.suffix} file that exists", "the name of a JSON file")
    return output_file_or_stream(path)


def output_folder(path: Path | None) -> Path | None:
    """The path of a folder to write files into: not that of a campaign, whose names may be taken."""
    return None if path is None else _check_folder(path)


def campaign_folder(path: Path | None) -> Path | None:
    """The path of the folder that a campaign flies in, or is to fly in."""
    return None if path is None else _check_folder(path, campaign=True)


def campaign_folder_or_address(path: Path | None) -> Path | None:
    """The same, or an address such as s3://bucket/folder."""
    return path if path is not None and _is_address(path) else campaign_folder(path)


def _check_folder(path: Path, campaign: bool = False) -> Path:
    if path.is_file():
        raise InputError(path, "a file", "the name of a folder")
    return _check(path, path.absolute(), campaign)


def _check(path: Path, home: Path, campaign: bool = False) -> Path:
    from abhv_mc.folder.layout import find_in_campaign

    if _is_address(path):
        raise InputError(path, "an address", "a place on this machine")
    place = find_in_campaign(path)
    if place is not None and not (campaign and place == Path()):
        raise InputError(
            path, "a place of the campaign's own files", "another name, or a place elsewhere"
        )
    there = next(folder for folder in (home, *home.parents) if folder.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        raise InputError(
            path, f"a place in {there}, which cannot be written", "a folder that can be"
        )
    return path


def _is_address(path: Path) -> bool:
    return read_address(f"{path}/") is not None  # of s3:// a path keeps s3:
