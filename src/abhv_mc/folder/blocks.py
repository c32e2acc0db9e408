"""The blocks of flights that lie in a folder: what of them counts as flown, so that the rest is known to be missing."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.flights import DamagedFileError, FlightRows, read_block
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.layout import CampaignFolder, hash_file
from abhv_mc.folder.samples import SampleReader


def read_flown_blocks(
    folder: CampaignFolder, runs: Mapping[str, int], samples: SampleReader, columns: tuple[str, ...], files: FileHashes
) -> Iterator[FlightRows]:
    """The whole blocks of each controller's ``runs`` flights, which the machine could compute all.

    Others are deleted, and their flights are missing then: blocks that are damaged, of other samples or metrics, that
    overlap, and those with a flight that could not be computed, which perhaps can be now.
    """
    flown = {name: np.zeros(number, bool) for name, number in runs.items()}
    for path in sorted(folder.flights.glob("*.parquet")):
        try:
            rows = read_own_block(path, samples.names, files)
            taken = flown.get(rows.controller, np.zeros(0, bool))
            fits = rows.stop <= len(taken) and not taken[rows.first : rows.stop].any() and rows.columns == columns
            if not (fits and np.array_equal(rows.samples, samples.rows(rows.first, rows.stop))):
                raise DamagedFileError(f"{path.name} belongs to no part of this campaign")
            if Outcome.FAILED_TO_RUN.code in rows.outcome:
                raise DamagedFileError(f"{path.name} has flights that could not be computed")
        except DamagedFileError:
            path.unlink()
            files.forget(path)
            continue
        taken[rows.first : rows.stop] = True
        yield rows


def read_own_block(path: Path, names: tuple[str, ...], files: FileHashes) -> FlightRows:
    """A block as this folder's campaign wrote it, listed in the manifest or not. Raises DamagedFileError."""
    known = files.knows(path)
    if known and (words := files.damage(path)):
        raise DamagedFileError(f"{path.name}: {words}")
    rows = read_block(path, names)
    if not known:  # it landed after the last manifest, and holds what it says
        files.note(path, hash_file(path))
    return rows
