"""Samples of a campaign as a Parquet file, or as a CSV file for another simulator."""

import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.parameters import Parameters
from abhv_mc.folder.flights import make_field, make_input_field, write_pieces
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.csv_table import write_batches
from abhv_mc.io.parquet_columns import column_values, number_column

POINT = "point"
ROW_GROUP = 65536  # number of flights that are drawn, written and read together


def row_groups(flights: int) -> Iterator[tuple[int, int]]:
    """Yield the range (first, stop) of the flights of each row group."""
    for first in range(0, flights, ROW_GROUP):
        yield first, min(first + ROW_GROUP, flights)


def write_samples(
    path: Path,
    names: Sequence[str],
    flights: int,
    draw: Callable[[int, int], Floats],
    provenance: dict[str, str],
    *,
    points: int = 1,
    table: Parameters,
) -> None:
    """Write all samples; ``draw(first, stop)`` returns values [flight, parameter].

    With several ``points`` of the unknowns, a column stores the point of flight k, which is k
    modulo ``points``.
    """
    parameters = [table[name] for name in names]
    schema = pa.schema(
        [
            make_field("flight", pa.int64(), "-", "number of the flight"),
            *(
                [make_field(POINT, pa.int64(), "-", "number of the point of the unknowns")]
                if points > 1
                else []
            ),
            *map(make_input_field, parameters),
        ],
        metadata={f"abhv_mc.{key}": text for key, text in provenance.items()},
    )

    def make_groups() -> Iterator[pa.Table]:
        for first, stop in row_groups(flights):
            number = np.arange(first, stop)
            columns = [
                *([number, number % points] if points > 1 else [number]),
                *draw(first, stop).T,
            ]
            yield pa.Table.from_arrays([*map(number_column, columns)], schema=schema)

    write_pieces(path, schema, make_groups(), [])


class SampleReader:
    """Reader that returns rows of a samples file by flight number.

    Two row groups are kept in memory. Threads may share a reader.
    """

    def __init__(self, path: Path) -> None:
        self._file = pq.ParquetFile(path, page_checksum_verification=True)
        self.names: tuple[str, ...] = tuple(
            n for n in self._file.schema_arrow.names[1:] if n != POINT
        )
        self.flights: int = self._file.metadata.num_rows
        self._groups: dict[int, Floats] = {}
        self._lock = threading.Lock()

    def rows(self, first: int, stop: int) -> Floats:
        """Return values [flight, parameter] for the flights ``first`` to ``stop - 1``."""
        pieces = []
        while first < stop:
            group = first // ROW_GROUP
            end = min(stop, (group + 1) * ROW_GROUP)
            pieces.append(self._read(group)[first - group * ROW_GROUP : end - group * ROW_GROUP])
            first = end
        return np.concatenate(pieces) if pieces else np.empty((0, len(self.names)))

    def agrees(self, draw: Callable[[int, int], Floats]) -> bool:
        """Return whether a function of the first flight and the stop returns the same rows."""
        groups = row_groups(self.flights)
        return all(np.array_equal(self.rows(*group), draw(*group)) for group in groups)

    def _read(self, group: int) -> Floats:
        with self._lock:  # Threads that start and store blocks may read different row groups.
            if group not in self._groups:
                table = self._file.read_row_group(group)
                columns = [column_values(table[name]) for name in self.names]
                values = np.stack(columns, axis=1) if columns else np.empty((table.num_rows, 0))
                before = {group - 1} & self._groups.keys()
                self._groups = {number: self._groups[number] for number in before} | {group: values}
            return self._groups[group]


def write_inputs(campaign: Experiment, path: Path) -> int:
    """Write one row per flight, with its number (from 0) and inputs; headers state units.

    Return the number of rows written.
    """
    source = campaign.make_samples()
    inputs = [campaign.parameters[name] for name in source.names]
    fields = [("flight", pa.int64())]
    for parameter in inputs:
        header = parameter.name if parameter.unit == "-" else f"{parameter.name} [{parameter.unit}]"
        fields.append(
            (header, pa.int64() if parameter.seed and parameter.of_user else pa.float64())
        )
    schema = pa.schema(fields)

    def batches() -> Iterator[pa.RecordBatch]:
        for first, stop in row_groups(source.flights):
            columns = [np.arange(first, stop), *source.draw(first, stop).T]
            arrays = [
                pa.array(column).cast(kind)
                for column, kind in zip(columns, schema.types, strict=True)
            ]
            yield pa.record_batch(arrays, schema=schema)

    with atomic_write(path) as temporary:
        write_batches(temporary, schema, batches())
    return source.flights
