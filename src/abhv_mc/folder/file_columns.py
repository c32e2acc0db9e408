"""Tables read a column at a time: a report of a million flights needs little more memory than one of a thousand."""

import os
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.io.documents import InputError
from abhv_mc.io.parquet_columns import column_values

_HELD = 32 * 2**20  # bytes of a table that stay in memory; a larger one goes to a temporary file
_CHUNK = 16_384  # rows written at once


def missing_file(path: Path, expected: str) -> InputError:
    """The error for a file that is not there."""
    return InputError(path, "no such file", expected)


@contextmanager
def _open(path: Path, expected: str) -> Iterator[pq.ParquetFile]:
    if not path.is_file():
        raise missing_file(path, expected)
    try:
        with pq.ParquetFile(path) as file:
            yield file
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(path, str(error).splitlines()[0], expected) from None


def read_table(path: Path, expected: str, columns: Sequence[str] | None = None) -> pa.Table:
    """All columns of a Parquet file, or some. Raises InputError where it is missing or unreadable."""
    with _open(path, expected) as file:
        return file.read(columns=columns, use_threads=file.num_row_groups > 1)


def read_pieces(
    path: Path, expected: str, columns: Sequence[str] | None = None
) -> Iterator[pa.Table]:
    """The same, a row group at a time."""
    with _open(path, expected) as file:
        for group in range(file.num_row_groups):
            yield file.read_row_group(group, columns=columns, use_threads=False)


class _Columns(Mapping[str, Floats]):
    """Columns whose names are known without reading them."""

    def __init__(self, names: Iterable[str]) -> None:
        self._places = {name: i for i, name in enumerate(names)}

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


class FileColumns(_Columns):
    """Columns [row] of a Parquet file, each read when it is asked for, and not kept."""

    def __init__(self, path: Path, expected: str, without: Sequence[str]) -> None:
        """All columns but `without`. Raises InputError where the file is missing or unreadable."""
        self._path, self._expected = path, expected
        with _open(path, expected) as file:
            super().__init__(name for name in file.schema_arrow.names if name not in without)

    def __getitem__(self, name: str) -> Floats:
        if name not in self._places:
            raise KeyError(name)
        return column_values(read_table(self._path, self._expected, [name])[name]).astype(
            np.float64
        )


class SpooledColumns(_Columns):
    """Columns [row] of a table that comes in pieces, each copied out when it is asked for.

    A table larger than a few ten megabytes lies in an unnamed temporary file, which goes with the object.
    """

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(names)
        self._waiting: list[Floats] = []  # pieces too small to be written alone
        self._chunks: list[int] = []  # rows of each
        self._order: NDArray[np.intp] | None = None
        self._file = tempfile.SpooledTemporaryFile(max_size=_HELD)  # noqa: SIM115
        weakref.finalize(self, self._file.close)

    def append(self, piece: Floats) -> None:
        """Add rows: [column, row]."""
        self._waiting.append(piece)
        if sum(part.shape[1] for part in self._waiting) >= _CHUNK:
            self._write()

    def _write(self) -> None:
        chunk = np.concatenate(self._waiting, axis=1)
        self._waiting = []
        self._chunks.append(chunk.shape[1])
        self._file.seek(0, os.SEEK_END)
        self._file.write(np.ascontiguousarray(chunk, dtype=np.float64).data)

    def put_in_order(self, order: NDArray[np.intp]) -> None:
        """Let row i of every column be the row `order[i]` as it came in."""
        self._order = order

    def __getitem__(self, name: str) -> Floats:
        place = self._places[name]
        if self._waiting:
            self._write()
        column = np.empty(sum(self._chunks))
        row = before = 0
        for rows in self._chunks:
            part = column[row : row + rows]
            self._file.seek(before + place * part.nbytes)
            if self._file.readinto(part.data.cast("B")) != part.nbytes:
                raise OSError("the temporary file of a table is truncated")
            before += len(self._places) * part.nbytes
            row += rows
        return column if self._order is None else column[self._order]
