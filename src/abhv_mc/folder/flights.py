"""Samples and blocks of flights as Parquet files with one row per flight, and their digest.

Two campaigns have the same digest if and only if their flights tables are equal. Each row is hashed
(BLAKE2b over controller, flight, outcome and the bits of every sample and metric), and the hashes
are added modulo 2**256. The sum does not depend on the order of flights, the block size or
interruptions. Flights that failed to run are excluded. Samples are also written as CSV files for
another simulator.
"""

import hashlib
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from abhv_mc.array_types import Floats, Ints
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.failure_cases import ENGINE_FAILED, NO_FAILURE, failure_cases
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.outcomes import OUTCOMES, Outcome, Outcomes
from abhv_mc.flights.parameters import Parameter, Parameters
from abhv_mc.flights.signals import Signal
from abhv_mc.folder.layout import write_whole
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.csv_table import write_batches
from abhv_mc.io.messages import is_exhausted
from abhv_mc.io.parquet_columns import column_values, number_column, text_column

END_TIME = Signal("end_time_s", "s", "time at which the flight ended")
CASE = "failure.case"
REASON = "reason"  # column with reasons why flights failed to run; not part of the digest
_LONGEST = 300  # maximum number of characters of a reason
INPUT = b"input"  # metadata key of input columns without a dot in the name
_DIGEST = b"abhv_mc.digest"
_MODULUS = 1 << 256


class DamagedFileError(Exception):
    """Error raised if the file of a block is damaged or does not match its name."""


@dataclass(frozen=True)
class Digest:
    """Digest of flights: the sum of the hashes of their rows."""

    value: int = 0

    def __add__(self, other: "Digest") -> "Digest":
        return Digest((self.value + other.value) % _MODULUS)

    def __str__(self) -> str:
        return f"{self.value:064x}"


def digest_rows(
    controller: str,
    flight: Ints,
    outcome: Sequence[str],
    columns: dict[str, Floats],
) -> Digest:
    """Return the digest of rows; ``columns`` are all samples and metrics by name."""
    names = sorted(columns)
    key = hashlib.blake2b(
        "|".join(["abhv-mc flights 1", controller, *names]).encode(), digest_size=32
    ).digest()
    values = np.column_stack([flight, *(columns[name] for name in names)]).astype("<f8")
    values[np.isnan(values)] = np.nan  # All NaNs get the same bit pattern.
    words, start = np.array(outcome, np.bytes_), hashlib.blake2b(digest_size=32, key=key)
    total = 0
    for word in {*outcome} - {Outcome.FAILED_TO_RUN.code}:
        own = words == word.encode()
        mark = f"{word}|".encode()
        kind = [("flight", "<i8"), ("word", f"S{len(mark)}"), ("values", "<f8", (len(names),))]
        rows = np.empty(np.count_nonzero(own), kind)
        rows["flight"], rows["word"], rows["values"] = flight[own], mark, values[own, 1:]
        text, size, hashes = rows.tobytes(), rows.itemsize, bytearray()
        for first in range(0, len(text), size):
            row = start.copy()
            row.update(text[first : first + size])
            hashes += row.digest()
        limbs = np.frombuffer(hashes, "<u4").reshape(-1, 8).sum(axis=0, dtype=np.uint64)
        total += sum(int(limb) << 32 * i for i, limb in enumerate(limbs))
    return Digest(total % _MODULUS)


@dataclass(frozen=True)
class FlightRows:
    """Block of rows for consecutive flights of one controller."""

    controller: str
    first: int
    names: tuple[str, ...]  # names of the sampled parameters
    samples: Floats  # [flight, parameter]
    outcome: tuple[str, ...]  # codes of the outcomes
    values: Floats  # [flight, value]
    columns: tuple[str, ...]  # names of the values: metrics, then the end time
    duration: float = np.inf  # duration of the mission, s
    reasons: tuple[str, ...] = ()  # reasons why flights failed to run, or empty

    @property
    def stop(self) -> int:
        """Number of the last flight plus one."""
        return self.first + len(self.outcome)

    @property
    def flights(self) -> Ints:
        """Numbers of the flights."""
        return np.arange(self.first, self.stop)

    def column(self, name: str) -> Floats:
        """Return the values [flight] of a metric."""
        return self.values[:, self.columns.index(name)]

    @property
    def end_time(self) -> Floats:
        """End time of each flight, s."""
        return self.column(END_TIME.name)

    @property
    def cases(self) -> list[str]:
        """Failure case of each flight; see :mod:`abhv_mc.flights.failure_cases`."""
        if ENGINE_FAILED not in self.columns:  # Custom simulators do not have this metric.
            return [NO_FAILURE] * len(self.outcome)
        ends = np.full(len(self.outcome), self.duration)
        return failure_cases(self.names, self.samples, ends, self.column(ENGINE_FAILED))

    def digest(self) -> Digest:
        """Return the digest of the rows."""
        columns = {name: self.samples[:, i] for i, name in enumerate(self.names)}
        columns |= {name: self.values[:, i] for i, name in enumerate(self.columns)}
        return digest_rows(self.controller, self.flights, self.outcome, columns)


def make_field(name: str, kind: pa.DataType, unit: str, doc: str, **metadata: str) -> pa.Field:
    """Return an Arrow field with unit and description."""
    return pa.field(name, kind, nullable=False, metadata={"unit": unit, "doc": doc, **metadata})


def make_input_field(parameter: Parameter) -> pa.Field:
    """Return the Arrow field of a sampled parameter."""
    mark = {} if "." in parameter.name else {INPUT.decode(): "yes"}
    return make_field(parameter.name, pa.float64(), parameter.unit, parameter.doc, **mark)


def _value_field(signal: Signal) -> pa.Field:
    """Return the Arrow field of a signal; metrics also have label, worse direction and group."""
    metadata = (
        {"label": signal.label, "bad": signal.bad, "group": signal.group}
        if isinstance(signal, Metric)
        else {}
    )
    return make_field(signal.name, pa.float64(), signal.unit, signal.doc, **metadata)


def flights_schema(
    names: Sequence[str],
    provenance: dict[str, str],
    values: Sequence[Signal],
    table: Parameters,
    ends: Outcomes = OUTCOMES,
) -> pa.Schema:
    """Return the schema of a flights table with the samples ``names`` and the ``values``."""
    outcomes = "; ".join(f"{code}: {ends.sentences[code]}" for code in ends.codes.values())
    fields = [
        make_field("flight", pa.int64(), "-", "number of the flight"),
        make_field("controller", pa.string(), "-", "name of the controller"),
        make_field("outcome", pa.string(), "-", outcomes),
        make_field(REASON, pa.string(), "-", "why the flight failed to run; empty otherwise"),
        make_field(
            CASE,
            pa.string(),
            "-",
            "failures drawn before the end of the mission, or 'none'",
        ),
        *(make_input_field(table[name]) for name in names),
        *map(_value_field, values),
    ]
    return pa.schema(fields, metadata={f"abhv_mc.{key}": text for key, text in provenance.items()})


def write_pieces(
    path: Path,
    schema: pa.Schema,
    pieces: Iterable[pa.Table],
    dictionary_columns: list[str],
    **options: Any,
) -> None:
    """Write a Parquet file with one row group per piece.

    Floats are byte-stream split, and only columns of repeated texts have dictionaries. Files are
    half as large as with the default settings of Parquet.
    """
    floats = [field.name for field in schema if pa.types.is_floating(field.type)]

    def write(temporary: Path) -> None:
        with pq.ParquetWriter(
            temporary,
            schema,
            use_dictionary=dictionary_columns,
            column_encoding=dict.fromkeys(floats, "BYTE_STREAM_SPLIT"),
            compression="zstd",
            compression_level=1,
            write_page_checksum=True,
            **options,
        ) as writer:
            for piece in pieces:
                writer.write_table(piece)

    write_whole(path, write)


def block_path(folder: Path, controller: str, first: int, stop: int) -> Path:
    """Return the path of the block with flights ``first`` to ``stop - 1`` of a controller."""
    return folder / f"{controller}-{first:09d}-{stop:09d}.parquet"


def parse_block_name(path: Path) -> tuple[str, int, int]:
    """Return the controller and the flight range (first, stop) in the name of a block file."""
    controller, _, stop = path.stem.rpartition("-")
    controller, _, first = controller.rpartition("-")
    if not (controller and first.isdecimal() and stop.isdecimal() and (first + stop).isascii()):
        raise DamagedFileError(f"{path.name} is not the name of a block")
    return controller, int(first), int(stop)


def write_block(folder: Path, rows: FlightRows, schema: pa.Schema) -> Digest:
    """Write a block to a file in ``folder`` and return the digest."""
    digest = rows.digest()
    count = len(rows.outcome)
    reasons = tuple(map(_plain_text, rows.reasons)) or ("",) * count
    texts = (rows.controller,) * count, rows.outcome, reasons, rows.cases
    columns = [number_column(rows.flights), *map(text_column, texts)]
    columns += map(number_column, (*rows.samples.T, *rows.values.T))
    table = pa.Table.from_arrays(columns, schema=schema)
    write_rows(block_path(folder, rows.controller, rows.first, rows.stop), schema, [table], digest)
    return digest


def _plain_text(reason: str) -> str:
    """Return a reason as one line of valid Unicode, limited in length."""
    return " ".join(reason.encode(errors="replace").decode().split())[:_LONGEST]


def write_rows(path: Path, schema: pa.Schema, pieces: Iterable[pa.Table], digest: Digest) -> None:
    """Write a file of flights that consists of ``pieces``."""
    schema = schema.with_metadata({**(schema.metadata or {}), _DIGEST: str(digest)})
    cast = (piece.replace_schema_metadata(schema.metadata) for piece in pieces)
    write_pieces(
        path, schema, cast, ["controller", "outcome", REASON, CASE], write_statistics=["flight"]
    )


def read_digest(path: Path) -> Digest:
    """Return the digest stored in a block file."""
    return Digest(int((pq.read_schema(path).metadata or {})[_DIGEST], 16))


def read_pieces(
    path: Path, names: Sequence[str], *, is_intact: bool = False
) -> Iterator[tuple[FlightRows, Digest]]:
    """Yield the row groups of a block file, with digests whose sum is the digest of the file.

    If ``is_intact``, because the hash of the file was checked, rows are not hashed. Raise
    DamagedFileError if the file is damaged. Some damage is detected only after the last row group.
    """
    controller, first, stop = parse_block_name(path)
    digest = Digest()
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            expected = (file.schema_arrow.metadata or {}).get(_DIGEST, b"").decode()
            stored = Digest(int(expected, 16)) if is_intact else None
            for group in range(file.num_row_groups):
                table = file.read_row_group(group)
                rows = _take_rows(table, controller, first, names)
                if not np.array_equal(column_values(table["flight"]), rows.flights):
                    break
                piece = rows.digest() if stored is None else stored
                stored = stored and Digest()
                digest, first = digest + piece, rows.stop
                yield rows, piece
    except (pa.ArrowException, OSError, KeyError, ValueError) as error:
        if is_exhausted(error):
            raise
        raise DamagedFileError(f"{path.name}: {str(error).splitlines()[0]}") from error
    if first != stop or str(digest) != expected:
        raise DamagedFileError(f"{path.name} does not match its digest")


def _take_rows(table: pa.Table, controller: str, first: int, names: Sequence[str]) -> FlightRows:
    sampled = [column_values(table[name]) for name in names]
    samples = np.stack(sampled, axis=1) if names else np.empty((table.num_rows, 0))
    names_stored = table.column_names
    columns = tuple(
        name for name in names_stored[names_stored.index(CASE) + 1 :] if name not in names
    )
    return FlightRows(
        controller=controller,
        first=first,
        names=tuple(names),
        samples=samples,
        outcome=tuple(table["outcome"].to_pylist()),
        values=np.stack([column_values(table[name]) for name in columns], axis=1),
        columns=columns,
        reasons=tuple(table[REASON].to_pylist()),
    )


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
