"""``abhv-mc export``: a campaign's tables as CSV."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import Folder
from abhv_mc.cli.outputs import output_folder
from abhv_mc.cli.printing import say


def command(
    folder: Folder,
    out: Annotated[
        Path | None,
        typer.Option("--output", "-o", callback=output_folder, metavar="DIR", help="Where to.", show_default="DIR/csv"),
    ] = None,
) -> None:
    """Write every table as a CSV file; numbers read back to the same bits."""
    from abhv_mc.folder.export import export_csv
    from abhv_mc.folder.remote import fetched, local_path
    from abhv_mc.io.input_error import InputError

    if out is None and local_path(folder) is None:
        raise InputError("--output", None, None, "nothing, for a campaign at an address", "-o DIR: where to")
    with fetched(folder) as source:
        for path in export_csv(source, out or folder / "csv"):
            say(path)
