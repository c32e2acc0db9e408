"""Samples that somebody else drew: a CSV or Parquet file with one column per parameter and one row per flight."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.io.input_files import read_input
from abhv_mc.io.number_table import read_number_table


@dataclass(frozen=True)
class SampleFile:
    """The file's content, SI; factors as they are."""

    names: tuple[str, ...]
    values: NDArray[np.float64]  # [flight, parameter]


def read_sample_file(path: Path, known: Sequence[str]) -> SampleFile:
    """Read samples whose columns are parameters, or a ``flight`` that counts from 0. Raises :class:`InputError`."""
    if path.suffix.lower() in (".parquet", ".pq"):
        table = _read_parquet(path)
    else:
        read = read_number_table(path)
        table = dict(zip(read.names, read.values.T, strict=True))
    names = tuple(name for name in table if name != "flight")
    for name in names:
        if name not in known:
            raise InputError(path, f"a column '{name}'", f"a parameter: {one_of(known, name)}", 1)
    if not names:
        raise InputError(path, "no column of a parameter", "at least one", 1)
    values = np.column_stack([table[name] for name in names])
    if not len(values):
        raise InputError(path, "no rows", "one row per flight", 1)
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0]
        raise InputError(path, f"{names[column]} that is not finite", "finite numbers", int(row) + 2)
    if "flight" in table and not np.array_equal(table["flight"], np.arange(len(values))):
        raise InputError(path, "a column 'flight' that does not count up from 0", "0, 1, 2, ...", 2)
    return SampleFile(names, values)


def _read_parquet(path: Path) -> dict[str, NDArray[np.float64]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(pa.BufferReader(read_input(path)))
        return {name: table[name].cast(pa.float64()).to_numpy() for name in table.column_names}
    except (pa.ArrowException, OSError) as error:
        raise InputError(path, str(error).splitlines()[0], "a Parquet file of numbers") from None
