"""Whether a Parquet file has the columns that a campaign writes: readers take them for numbers without another look."""

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from abhv_mc.flight.channels import CHANNELS
from abhv_mc.flight.metrics import METRICS
from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.flights import CASE, END_TIME, DamagedFileError, parse_block_name
from abhv_mc.folder.samples import ROW_GROUP
from abhv_mc.io.input_error import InputError, is_printable, one_of

_WISH = "a table as a campaign writes it: restore it, or make it anew (abhv-mc run)"
_KEYS = {
    "flight": pa.int64(),
    "controller": pa.string(),
    "outcome": pa.string(),
    CASE: pa.string(),
    "channel": pa.string(),
    "time": pa.float64(),
    "count": pa.int64(),
}
_NEEDED = {
    "flights": ("flight", "controller", "outcome", END_TIME.name, *(signal.name for signal in METRICS)),
    "samples": ("flight",),
    "histories": ("flight", "controller", "time"),
    "envelopes": ("controller", "channel", "time", "count", "min", "q0.135", "q5", "q50", "q95", "q99.865", "max"),
    "nominal": ("controller", "time", *(signal.name for signal in CHANNELS)),
    "reference": ("time",),
}
_MOST_ROWS = 2**31


def check_table(path: Path) -> None:
    """Raises InputError for a file of a campaign's folder whose columns, types or size are not a campaign's."""
    kind = path.stem if path.stem in _NEEDED else path.parent.name
    try:
        with pq.ParquetFile(path) as file:
            schema, rows = file.schema_arrow, file.metadata.num_rows
            held = sum(file.metadata.row_group(group).num_rows for group in range(file.num_row_groups))
        if held != rows:
            raise InputError(path, None, None, f"{held} rows where its end says {rows}", _WISH)
        if kind == "flights":
            controller, first, stop = parse_block_name(path)
            if rows != stop - first:
                raise InputError(path, None, None, f"{rows} rows", f"the {stop - first} of its name")
    except (pa.ArrowException, OSError, ValueError, DamagedFileError) as error:
        raise InputError(path, None, None, str(error).splitlines()[0], _WISH) from None
    names = schema.names
    if len(set(names)) < len(names):
        raise InputError(path, None, None, "two columns of one name", _WISH)
    odd = [name for name in names if not is_printable(name)]
    if odd:
        raise InputError(path, None, None, f"a column '{odd[0]}'", _WISH)
    missing = [name for name in _NEEDED.get(kind, ()) if name not in names]
    if missing:
        raise InputError(path, None, None, f"no column '{missing[0]}'", _WISH)
    if not (rows <= _MOST_ROWS and (rows or kind == "histories")):
        raise InputError(path, None, None, f"{rows} rows", _WISH)
    for field in schema:
        wanted = _KEYS.get(field.name)
        right = field.type == wanted if wanted else pa.types.is_float32(field.type) or pa.types.is_float64(field.type)
        if not right:
            raise InputError(path, None, None, f"a column '{field.name}' of {field.type}", _WISH)
    words: dict[str, list[str] | None] = {field.name: None for field in schema if field.type == pa.string()}
    if kind == "flights":
        words |= {"outcome": [outcome.code for outcome in Outcome], "controller": [controller]}
    _check_words(path, words)
    if kind == "flights":
        _check_flights(path, first, stop)
    if kind == "samples":
        _check_flights(path, 0, rows)
        _check_samples(path)


def _check_words(path: Path, wanted: Mapping[str, list[str] | None]) -> None:
    """Raises InputError for columns that hold no text, or words that no campaign writes (None: any)."""
    if not wanted:
        return
    with refusing(path), pq.ParquetFile(path, read_dictionary=list(wanted)) as file:  # read_table would import pandas
        table = file.read(columns=list(wanted))
        found = {column: table[column].unique().to_pylist() for column in wanted}
    for column, known in wanted.items():
        for word in found[column]:
            if known is not None and word not in known:
                raise InputError(path, None, None, f"the {column} '{word}'", one_of(known))


def _check_flights(path: Path, first: int, stop: int) -> None:
    """Raises InputError for rows of other flights, or in another order."""
    with refusing(path), pq.ParquetFile(path) as file:
        numbers = file.read(columns=["flight"])["flight"].to_numpy()
    if not np.array_equal(numbers, np.arange(first, stop)):
        raise InputError(path, None, None, "other flights", f"{first} to {stop - 1}, in this order")


def _check_samples(path: Path) -> None:
    """Raises InputError for rows in other groups than they are read in, and for what no flight can fly."""
    with refusing(path), pq.ParquetFile(path, page_checksum_verification=True) as file:
        sizes = [file.metadata.row_group(group).num_rows for group in range(file.num_row_groups)]
        if any(size != ROW_GROUP for size in sizes[:-1]) or sizes[-1] > ROW_GROUP:
            raise InputError(path, None, None, f"rows in groups of {sizes[0]}", f"groups of {ROW_GROUP}")
        for group in range(file.num_row_groups):
            for name, column in zip(file.schema_arrow.names, file.read_row_group(group).columns, strict=True):
                if column.null_count or np.isnan(column.to_numpy()).any():  # a failure that never comes is at infinity
                    raise InputError(path, None, None, f"a '{name}' that is no number", _WISH)


@contextlib.contextmanager
def refusing(path: Path) -> Iterator[None]:
    """Make an InputError of what a damaged or forged file raises."""
    try:
        yield
    except (pa.ArrowException, OSError, ValueError) as error:  # or bytes that are no text
        raise InputError(path, None, None, str(error).splitlines()[0], _WISH) from None
