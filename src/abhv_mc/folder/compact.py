"""Small files of flights joined into files of about a million rows: 1e7 flights have thousands of blocks."""

from collections.abc import Iterator, Sequence
from itertools import groupby, pairwise
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from abhv_mc.folder.digest import Digest
from abhv_mc.folder.flights import block_path, parse_block_name, read_digest, write_rows

ROWS = 1 << 20  # of a joined file at most
MANY = 64  # files of a controller that are left as they are
_GROUP = 1 << 16  # rows in memory, and of a row group


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
