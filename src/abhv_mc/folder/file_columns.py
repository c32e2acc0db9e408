"""Tables whose columns are read one at a time, to save memory in large campaigns."""

import os
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from abhv_mc.array_types import Floats, Indices
from abhv_mc.io.messages import InputError
from abhv_mc.io.parquet_columns import column_values

_IN_MEMORY = 32 * 2**20  # maximum size of a table in memory, bytes
_CHUNK = 16_384  # number of rows that are written at once


def missing_file(path: Path, expected: str) -> InputError:
    """Return the InputError for a missing file."""
    return InputError(path, "no such file", expected)


@contextmanager
def _open(path: Path, expected: str, texts: Sequence[str] = ()) -> Iterator[pq.ParquetFile]:
    if not path.is_file():
        raise missing_file(path, expected)
    try:
        with pq.ParquetFile(path, read_dictionary=texts) as file:
            yield file
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(path, str(error).splitlines()[0], expected) from None


def read_table(
    path: Path, expected: str, columns: Sequence[str] | None = None, *, texts: Sequence[str] = ()
) -> pa.Table:
    """Read columns of a Parquet file, and those in ``texts`` as dictionaries.

    Raise InputError if the file is missing or invalid.
    """
    with _open(path, expected, texts) as file:
        return file.read(columns=columns, use_threads=file.num_row_groups > 1)


def read_pieces(
    path: Path, expected: str, columns: Sequence[str] | None = None
) -> Iterator[pa.Table]:
    """Yield the row groups of a Parquet file, with all columns or a selection."""
    with _open(path, expected) as file:
        for group in range(file.num_row_groups):
            yield file.read_row_group(group, columns=columns, use_threads=False)


class _Columns(Mapping[str, Floats]):
    """Mapping of column names to columns that are read on access."""

    def __init__(self, names: Iterable[str]) -> None:
        self._positions = {name: i for i, name in enumerate(names)}

    def __contains__(self, name: object) -> bool:
        return name in self._positions

    def __iter__(self) -> Iterator[str]:
        return iter(self._positions)

    def __len__(self) -> int:
        return len(self._positions)


class FileColumns(_Columns):
    """Columns [row] of a Parquet file; each access reads the file."""

    def __init__(self, path: Path, expected: str, without: Sequence[str]) -> None:
        """Open the file, ignoring the columns ``without``.

        Raise InputError if the file is missing or invalid.
        """
        self._path, self._expected = path, expected
        with _open(path, expected) as file:
            super().__init__(name for name in file.schema_arrow.names if name not in without)

    def __getitem__(self, name: str) -> Floats:
        if name not in self._positions:
            raise KeyError(name)
        return column_values(read_table(self._path, self._expected, [name])[name]).astype(
            np.float64
        )


class SpooledColumns(_Columns):
    """Columns [row] of a table assembled from pieces; each access returns a copy of a column.

    A large table is stored in an unnamed temporary file, which is deleted with the object.
    """

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(names)
        self._waiting: list[Floats] = []  # pieces not yet written
        self._chunks: list[int] = []  # number of rows in each written chunk
        self._order: Indices | None = None
        self._file = tempfile.SpooledTemporaryFile(max_size=_IN_MEMORY)  # noqa: SIM115
        weakref.finalize(self, self._file.close)

    def append(self, piece: Floats) -> None:
        """Add rows [column, row]."""
        self._waiting.append(piece)
        if sum(waiting.shape[1] for waiting in self._waiting) >= _CHUNK:
            self._write()

    def _write(self) -> None:
        chunk = np.concatenate(self._waiting, axis=1)
        self._waiting = []
        self._chunks.append(chunk.shape[1])
        self._file.seek(0, os.SEEK_END)
        self._file.write(np.ascontiguousarray(chunk, dtype=np.float64).data)

    def put_in_order(self, order: Indices) -> None:
        """Reorder the rows: row i becomes the row that was added as row ``order[i]``."""
        self._order = order

    def __getitem__(self, name: str) -> Floats:
        position = self._positions[name]
        if self._waiting:
            self._write()
        column = np.empty(sum(self._chunks))
        row = offset = 0
        for rows in self._chunks:
            target = column[row : row + rows]
            self._file.seek(offset + position * target.nbytes)
            if self._file.readinto(target.data.cast("B")) != target.nbytes:
                raise OSError("the temporary file of a table is truncated")
            offset += len(self._positions) * target.nbytes
            row += rows
        return column if self._order is None else column[self._order]
