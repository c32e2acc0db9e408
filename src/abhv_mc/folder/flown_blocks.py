"""Check of the blocks of flights in a results folder, and their merge into larger files.

Merged files have about a million rows, because campaigns of 1e7 flights have thousands of blocks.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flights import (
    DamagedFileError,
    Digest,
    FlightRows,
    SampleReader,
    block_path,
    parse_block_name,
    read_digest,
    read_pieces,
    write_rows,
)
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.layout import CampaignFolder, hash_file

ROWS = 1 << 20  # maximum number of rows of a merged file
MANY = 64  # maximum number of files of a controller that are left unmerged
_GROUP = 1 << 16  # number of rows in a row group


def read_flown_blocks(
    folder: CampaignFolder,
    runs: Mapping[str, int],
    samples: SampleReader,
    columns: tuple[str, ...],
    files: FileHashes,
    *,
    keep_failed_to_run: bool = False,
) -> Iterator[tuple[FlightRows, Digest]]:
    """Yield the valid blocks of each controller, with their digests.

    Invalid blocks are deleted, and their flights are run again. A block is invalid if it is
    damaged, has other samples or metrics, overlaps another block, or (unless
    ``keep_failed_to_run``) contains a flight that failed to run. Files that the manifest lists are
    read first, because a killed run may leave a merged file next to the files that were merged.
    """
    masks = {name: np.zeros(number, bool) for name, number in runs.items()}
    listed = [path for path in files.paths() if path.parent == folder.flights]
    files.forget(
        *(path for path in listed if not path.is_file())
    )  # Flights of invalid blocks are computed again.
    for path in sorted(
        folder.flights.glob("*.parquet"), key=lambda path: (not files.knows(path), path)
    ):
        pieces = 0
        try:
            controller, first, stop = parse_block_name(path)
            taken = masks.get(controller, np.zeros(0, bool))
            if stop > len(taken) or taken[first:stop].any():
                raise DamagedFileError(f"{path.name} overlaps other blocks or the last flight")
            for rows, digest in read_campaign_block(path, samples.names, files):
                pieces, block = pieces + 1, (rows, digest)
                if rows.columns != columns or not np.array_equal(
                    rows.samples, samples.rows(rows.first, rows.stop)
                ):
                    raise DamagedFileError(f"{path.name} has other samples or metrics")
                if not keep_failed_to_run and Outcome.FAILED_TO_RUN.code in rows.outcome:
                    raise DamagedFileError(f"{path.name} has flights that could not be computed")
        except DamagedFileError:
            path.unlink()
            files.forget(path)
            continue
        taken[first:stop] = True
        if pieces == 1:
            yield block
        else:  # The file is too large for memory.
            yield from read_pieces(path, samples.names, is_intact=True)


def read_campaign_block(
    path: Path, names: tuple[str, ...], files: FileHashes
) -> Iterator[tuple[FlightRows, Digest]]:
    """Yield the row groups of a stored block, with their digests.

    Raise DamagedFileError if the block is damaged. Some damage is detected only after the last row
    group.
    """
    is_listed = files.knows(path)
    if is_listed and (damage := files.damage(path)):
        raise DamagedFileError(f"{path.name}: {damage}")
    yield from read_pieces(path, names, is_intact=is_listed)
    if not is_listed:  # The file is newer than the manifest, and it matches its digest.
        files.note(path, hash_file(path))


def find_joins(paths: Sequence[Path]) -> list[list[Path]]:
    """Return groups of adjacent files to merge, if a controller has many files."""
    joins = []
    blocks = sorted((*parse_block_name(path), path) for path in paths)
    for _, group in groupby(blocks, key=lambda block: block[0]):
        files = list(group)
        if len(files) <= MANY:
            continue
        runs = [[files[0]]]
        for before, block in pairwise(files):
            if block[1] == before[2] and block[2] - runs[-1][0][1] <= ROWS:
                runs[-1].append(block)
            else:
                runs.append([block])
        joins += [[path for *_, path in run] for run in runs if len(run) > 1]
    return joins


def join_files(paths: Sequence[Path]) -> Path:
    """Join adjacent files into one file, whose digest is the sum of the files' digests.

    Return the path of the joined file. The source files are kept.
    """
    controller, first, _ = parse_block_name(paths[0])
    joined = block_path(paths[0].parent, controller, first, parse_block_name(paths[-1])[2])
    digest = sum(map(read_digest, paths), Digest())
    write_rows(joined, pq.read_schema(paths[0]), _read_groups(paths), digest)
    return joined


def _read_groups(paths: Sequence[Path]) -> Iterator[pa.Table]:
    """Yield the rows of files in order, as tables of about one row group."""
    waiting = []
    for path in paths:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            for group in range(file.num_row_groups):
                waiting.append(file.read_row_group(group).replace_schema_metadata())
                if sum(table.num_rows for table in waiting) >= _GROUP:
                    yield pa.concat_tables(waiting)
                    waiting = []
    if waiting:
        yield pa.concat_tables(waiting)
