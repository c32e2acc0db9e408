"""Checks of output paths, called by typer before a command starts."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from abhv_mc.io.address import read_address
from abhv_mc.io.input_error import InputError

_INPUTS = (".yaml", ".yml", ".py", ".csv", ".parquet")


def output(
    check: Callable[[Path | None], Path | None],
    metavar: str,
    purpose: str,
    default: str | bool = True,
) -> Any:
    """Return the option ``--output``; ``default`` describes the default path."""
    return typer.Option(
        "--output", "-o", callback=check, metavar=metavar, help=purpose, show_default=default
    )


def output_file(path: Path | None) -> Path | None:
    """Return the path of an output file. Raise InputError if the file cannot be written."""
    if path is None:
        return None
    # If root wrote to /dev/null, the file would replace the device.
    if path.exists() and not path.is_file():
        raise InputError(path, "the path is a folder or a device", "the name of a file")
    return _check(path, path.absolute().parent)


def output_file_or_stream(path: Path | None) -> Path | None:
    """Return the path of an output file, or ``-`` for standard output.

    Raise InputError if the file cannot be written.
    """
    return path if path == Path("-") else output_file(path)


def json_file(path: Path | None) -> Path | None:
    """Return the path of a JSON output file, or ``-`` for standard output.

    Raise InputError if the file cannot be written, or if an existing input file would be
    overwritten.
    """
    if path is not None and path.suffix in _INPUTS and path.exists():
        raise InputError(
            path, f"an existing {path.suffix} file would be replaced", "the name of a JSON file"
        )
    return output_file_or_stream(path)


def output_folder(path: Path | None) -> Path | None:
    """Return the path of an output folder.

    Raise InputError if the path belongs to the results folder of a campaign.
    """
    return None if path is None else _check_folder(path)


def campaign_folder(path: Path | None) -> Path | None:
    """Return the path of a new or existing results folder.

    Raise InputError if the path cannot be used as a results folder.
    """
    return None if path is None else _check_folder(path, campaign=True)


def campaign_folder_or_address(path: Path | None) -> Path | None:
    """Return the path of a results folder, or an address such as s3://bucket/folder."""
    return path if path is not None and _is_address(path) else campaign_folder(path)


def _check_folder(path: Path, campaign: bool = False) -> Path:
    if path.is_file():
        raise InputError(path, "the path is a file", "the name of a folder")
    return _check(path, path.absolute(), campaign)


def _check(path: Path, folder: Path, campaign: bool = False) -> Path:
    from abhv_mc.folder.layout import find_in_campaign

    if _is_address(path):
        raise InputError(path, "the path is an address", "a path on this machine")
    location = find_in_campaign(path)
    if location is not None and not (campaign and location == Path()):
        raise InputError(
            path,
            "the path is inside the folder of a campaign",
            "a path outside campaign folders",
        )
    existing = next(parent for parent in (folder, *folder.parents) if parent.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(path, f"{existing} cannot be written", "a path in a writable folder")
    return path


def _is_address(path: Path) -> bool:
    return read_address(f"{path}/") is not None  # Path("s3://") drops the slashes.
