"""All that is held against published data, section by section."""

from collections.abc import Iterator
from pathlib import Path

from abhv_mc.io.input_error import InputError
from abhv_mc.verification.ghame6 import verify_ghame6
from abhv_mc.verification.nesc import verify_nesc
from abhv_mc.verification.paper import verify_paper
from abhv_mc.verification.rows import Row


def verify_everything(folder: Path | None, scale: float = 1.0) -> Iterator[tuple[str, list[Row]]]:
    """Names and rows of the references in a folder, if any, and of the papers' numbers.

    The folder holds check-cases in ``nesc`` and recordings in ``cadac-ghame6``; ``scale`` multiplies the tolerances.
    """
    if folder is not None:
        recordings = sorted((folder / "cadac-ghame6").glob("*.csv*"))
        if not recordings:
            raise InputError(folder, None, None, "no recording", "a CSV file in its folder cadac-ghame6")
        yield "check-cases", verify_nesc(folder / "nesc", scale)
        for recording in recordings:
            yield f"recording {recording.name}", verify_ghame6(recording, scale)
    yield "papers", verify_paper(scale)
