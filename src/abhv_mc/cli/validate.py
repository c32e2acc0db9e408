"""``abhv-mc validate``: check files without flying."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Campaign, vehicle, mission or controller.")],
) -> None:
    """Check files, and the files that they name, without flying."""
    from abhv_mc.campaign.inputs import check_inputs
    from abhv_mc.documents import InputError, InputErrors

    errors: list[InputError] = []
    for file in files:
        try:
            checked = check_inputs(file)
        except InputErrors as several:
            errors.extend(several.errors)
            continue
        for found in checked:
            print(f"{found.path}: a valid {found.kind} file")
            for warning in found.warnings:
                print(f"{found.path}: warning: {warning}")
    if errors:
        raise InputErrors(errors)
