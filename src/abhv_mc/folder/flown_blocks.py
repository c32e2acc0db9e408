"""The blocks of flights that lie in a folder: what of them counts as flown, so that the rest is known to be missing;
and how they become files of about a million rows, as 1e7 flights have thousands of blocks."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.flights import (
    DamagedFileError,
    Digest,
    FlightRows,
    block_path,
    parse_block_name,
    read_digest,
    read_pieces,
    write_rows,
)
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.layout import CampaignFolder, hash_file
from abhv_mc.folder.samples import SampleReader

ROWS = 1 << 20  # of a joined file at most
MANY = 64  # files of a controller that are left as they are
_GROUP = 1 << 16  # rows in memory, and of a row group


def read_flown_blocks(
    folder: CampaignFolder,
    runs: Mapping[str, int],
    samples: SampleReader,
    columns: tuple[str, ...],
    files: FileHashes,
    *,
    keep_lost: bool = False,
) -> Iterator[tuple[FlightRows, Digest]]:
    """The whole blocks of each controller's ``runs`` flights, which the machine could compute all, with their digests.

    Others are deleted, and their flights are missing then: blocks that are damaged, of other samples or metrics, that
    overlap, and (unless ``keep_lost``) those with a flight that could not be computed, which perhaps can be now. Files
    that the manifest names come first: where a kill left a joined file beside those that it is made of, they count.
    """
    flown = {name: np.zeros(number, bool) for name, number in runs.items()}
    known = [path for path in files.paths() if path.parent == folder.flights]
    files.forget(
        *(path for path in known if not path.is_file())
    )  # their flights are computed again
    for path in sorted(
        folder.flights.glob("*.parquet"), key=lambda path: (not files.knows(path), path)
    ):
        pieces = 0
        try:
            controller, first, stop = parse_block_name(path)
            taken = flown.get(controller, np.zeros(0, bool))
            if stop > len(taken) or taken[first:stop].any():
                raise DamagedFileError(f"{path.name} belongs to no part of this campaign")
            for rows, digest in read_own_block(path, samples.names, files):
                pieces, held = pieces + 1, (rows, digest)
                if rows.columns != columns or not np.array_equal(
                    rows.samples, samples.rows(rows.first, rows.stop)
                ):
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


def read_own_block(
    path: Path, names: tuple[str, ...], files: FileHashes
) -> Iterator[tuple[FlightRows, Digest]]:
    """A block as this folder's campaign wrote it, listed in the manifest or not, in pieces with their digests.

    Raises DamagedFileError, at the end at the latest.
    """
    known = files.knows(path)
    if known and (words := files.damage(path)):
        raise DamagedFileError(f"{path.name}: {words}")
    yield from read_pieces(path, names)
    if not known:  # it landed after the last manifest, and holds what it says
        files.note(path, hash_file(path))


def find_joins(paths: Sequence[Path]) -> list[list[Path]]:
    """Which files to join, each with its neighbours; none of a controller with few files."""
    joins = []
    blocks = sorted((*parse_block_name(path), path) for path in paths)
    for _, group in groupby(blocks, key=lambda block: block[0]):
        mine = list(group)
        if len(mine) <= MANY:
            continue
        parts = [[mine[0]]]
        for before, block in pairwise(mine):
            if block[1] == before[2] and block[2] - parts[-1][0][1] <= ROWS:
                parts[-1].append(block)
            else:
                parts.append([block])
        joins += [[path for *_, path in part] for part in parts if len(part) > 1]
    return joins


def join_files(paths: Sequence[Path]) -> Path:
    """Write the file that holds the rows of neighbouring files, beside them; their digests add up to its own."""
    controller, first, _ = parse_block_name(paths[0])
    joined = block_path(paths[0].parent, controller, first, parse_block_name(paths[-1])[2])
    digest = sum(map(read_digest, paths), Digest())
    write_rows(joined, pq.read_schema(paths[0]), _read_groups(paths), digest)
    return joined


def _read_groups(paths: Sequence[Path]) -> Iterator[pa.Table]:
    """Rows of files in order, about so many at once as are a row group."""
    waiting: list[pa.Table] = []
    for path in paths:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            for group in range(file.num_row_groups):
                waiting.append(file.read_row_group(group).replace_schema_metadata())
                if sum(table.num_rows for table in waiting) >= _GROUP:
                    yield pa.concat_tables(waiting)
                    waiting = []
    if waiting:
        yield pa.concat_tables(waiting)
