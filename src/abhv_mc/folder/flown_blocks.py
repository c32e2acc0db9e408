"""The blocks of flights that lie in a folder: what of them counts as flown, so that the rest is known to be missing."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.digest import Digest
from abhv_mc.folder.flights import DamagedFileError, FlightRows, parse_block_name, read_pieces
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.layout import CampaignFolder, hash_file
from abhv_mc.folder.samples import SampleReader


def read_flown_blocks(
    folder: CampaignFolder,
    runs: Mapping[str, int],
    samples: SampleReader,
    columns: tuple[str, ...],
    files: FileHashes,
    keep_lost: bool = False,
) -> Iterator[tuple[FlightRows, Digest]]:
    """The whole blocks of each controller's ``runs`` flights, which the machine could compute all, with their digests.

    Others are deleted, and their flights are missing then: blocks that are damaged, of other samples or metrics, that
    overlap, and (unless ``keep_lost``) those with a flight that could not be computed, which perhaps can be now. Files
    that the manifest names come first: where a kill left a joined file beside those that it is made of, they count.
    """
    flown = {name: np.zeros(number, bool) for name, number in runs.items()}
    for path in sorted(folder.flights.glob("*.parquet"), key=lambda path: (not files.knows(path), path)):
        pieces = 0
        try:
            controller, first, stop = parse_block_name(path)
            taken = flown.get(controller, np.zeros(0, bool))
            if stop > len(taken) or taken[first:stop].any():
                raise DamagedFileError(f"{path.name} belongs to no part of this campaign")
            for rows, digest in read_own_block(path, samples.names, files):
                pieces, held = pieces + 1, (rows, digest)
                if rows.columns != columns or not np.array_equal(rows.samples, samples.rows(rows.first, rows.stop)):
                    raise DamagedFileError(f"{path.name} belongs to no part of this campaign")
                if not keep_lost and Outcome.FAILED_TO_RUN.code in rows.outcome:
                    raise DamagedFileError(f"{path.name} has flights that could not be computed")
        except DamagedFileError:
            path.unlink()
            files.forget(path)
            continue
        taken[first:stop] = True
        if pieces == 1:
            yield held
        else:  # too much to be held
            yield from read_pieces(path, samples.names)


def read_own_block(path: Path, names: tuple[str, ...], files: FileHashes) -> Iterator[tuple[FlightRows, Digest]]:
    """A block as this folder's campaign wrote it, listed in the manifest or not, in pieces with their digests.

    Raises DamagedFileError, at the end at the latest.
    """
    known = files.knows(path)
    if known and (words := files.damage(path)):
        raise DamagedFileError(f"{path.name}: {words}")
    yield from read_pieces(path, names)
    if not known:  # it landed after the last manifest, and holds what it says
        files.note(path, hash_file(path))
