"""All that is held against published data."""

from pathlib import Path

from abhv_mc.io.input_error import InputError
from abhv_mc.verification.check_rows import Row
from abhv_mc.verification.ghame6 import verify_ghame6
from abhv_mc.verification.nesc import verify_nesc
from abhv_mc.verification.paper import verify_paper


def verify_everything(folder: Path | None, scale: float = 1.0) -> list[Row]:
    """Rows of the references in a folder, if any, and of the papers' numbers.

    The folder holds check-cases in ``nesc`` and recordings in ``cadac-ghame6``; ``scale`` multiplies the tolerances.
    """
    rows: list[Row] = []
    if folder is not None:
        recordings = sorted((folder / "cadac-ghame6").glob("*.csv*"))
        if not recordings:
            raise InputError(folder, "no recording", "a CSV file in its folder cadac-ghame6")
        rows = verify_nesc(folder / "nesc", scale)
        for recording in recordings:
            rows += verify_ghame6(recording, scale)
    return rows + verify_paper(scale)
