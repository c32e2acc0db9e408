"""Blocks of flown flights as Parquet: one row per flight and controller, whole and checked; and their digest.

A campaign's digest is equal exactly when its flights tables are, however they were flown: each row is hashed alone
(BLAKE2b over controller, flight, outcome and the bits of every sample and metric) and the hashes are added modulo
2**256. The sum knows no order, no block size and no resume. Rows of flights that could not be computed on a machine
(``failed_to_run``) say nothing about the vehicle and are left out.
"""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.channels import Signal
from abhv_mc.flight.failure_case import NO_FAILURE, failure_cases
from abhv_mc.flight.metrics import ENGINE_FAILED, METRICS, Metric
from abhv_mc.flight.outcome import OUTCOMES, Outcome, Outcomes
from abhv_mc.folder.layout import write_whole
from abhv_mc.io.input_error import is_exhausted
from abhv_mc.io.parquet_columns import column_values, number_column, text_column
from abhv_mc.plant.parameters import OURS, Parameter, Parameters

END_TIME = Signal("end_time_s", "s", "time at which the flight ended")
VALUES = (
    *METRICS,
    END_TIME,
)  # the columns after the samples, and before them a campaign's own metrics
_VALUE_NAMES = tuple(signal.name for signal in VALUES)
CASE = "failure.case"
REASON = "reason"  # why a flight failed to run; it enters no digest
_LONGEST = 300  # characters of a reason
INPUT = b"input"  # marks columns of samples whose names have no point
_DIGEST = b"abhv_mc.digest"
_MODULUS = 1 << 256


class DamagedFileError(Exception):
    """A block file that is truncated or does not hold what its name says; it is flown again."""


@dataclass(frozen=True)
class Digest:
    """A sum of row hashes."""

    value: int = 0

    def __add__(self, other: "Digest") -> "Digest":
        return Digest((self.value + other.value) % _MODULUS)

    def __str__(self) -> str:
        return f"{self.value:064x}"


def digest_rows(
    controller: str,
    flight: NDArray[np.int64],
    outcome: Sequence[str],
    columns: dict[str, NDArray[np.float64]],
) -> Digest:
    """Digest of rows; ``columns`` are all samples and metrics by name, in any order."""
    names = sorted(columns)
    key = hashlib.blake2b(
        "|".join(["abhv-mc flights 1", controller, *names]).encode(), digest_size=32
    ).digest()
    values = (
        np.stack([columns[name] for name in names], axis=1).astype("<f8")
        if names
        else np.empty((len(flight), 0))
    )
    values[np.isnan(values)] = np.nan  # one bit pattern for every not-a-number
    failed = Outcome.FAILED_TO_RUN.code
    total = 0
    for number, word, row in zip(
        flight.astype("<i8"), outcome, np.ascontiguousarray(values), strict=True
    ):
        if word != failed:
            text = number.tobytes() + word.encode() + b"|" + row.tobytes()
            total += int.from_bytes(
                hashlib.blake2b(text, digest_size=32, key=key).digest(), "little"
            )
    return Digest(total % _MODULUS)


@dataclass(frozen=True)
class FlightRows:
    """The rows of one block of one controller, ascending by flight without gaps."""

    controller: str
    first: int
    names: tuple[str, ...]  # of the sampled parameters
    samples: Floats  # [flight, parameter]
    outcome: tuple[str, ...]  # codes
    values: Floats  # [flight, value]
    columns: tuple[str, ...] = _VALUE_NAMES  # of the values: the metrics, then the time of the end
    duration: float = np.inf  # of the mission, s
    reasons: tuple[str, ...] = ()  # why flights failed to run; empty if none has a reason

    @property
    def stop(self) -> int:
        return self.first + len(self.outcome)

    @property
    def flights(self) -> NDArray[np.int64]:
        return np.arange(self.first, self.stop)

    def column(self, name: str) -> Floats:
        """The values ``[flight]`` of a metric."""
        return self.values[:, self.columns.index(name)]

    @property
    def end_time(self) -> Floats:
        """When each flight ended, s."""
        return self.column(END_TIME.name)

    @property
    def cases(self) -> list[str]:
        """What failed in each flight; see :mod:`abhv_mc.flight.failure_case`."""
        if ENGINE_FAILED not in self.columns:  # of a user's simulator
            return [NO_FAILURE] * len(self.outcome)
        ends = np.full(len(self.outcome), self.duration)
        return failure_cases(self.names, self.samples, ends, self.column(ENGINE_FAILED))

    def digest(self) -> Digest:
        columns = {name: self.samples[:, i] for i, name in enumerate(self.names)}
        columns |= {name: self.values[:, i] for i, name in enumerate(self.columns)}
        return digest_rows(self.controller, self.flights, self.outcome, columns)


def make_field(name: str, kind: pa.DataType, unit: str, doc: str, **more: str) -> pa.Field:
    """A column with its unit and meaning."""
    return pa.field(name, kind, nullable=False, metadata={"unit": unit, "doc": doc, **more})


def make_input_field(parameter: Parameter) -> pa.Field:
    """A column of samples."""
    more = {} if "." in parameter.name else {INPUT.decode(): "yes"}
    return make_field(parameter.name, pa.float64(), parameter.unit, parameter.doc, **more)


def _value_field(signal: Signal) -> pa.Field:
    """A column of a metric, with what is bad of it, or of another number."""
    words = (
        {"label": signal.label, "bad": signal.bad, "group": signal.group}
        if isinstance(signal, Metric)
        else {}
    )
    return make_field(signal.name, pa.float64(), signal.unit, signal.doc, **words)


def flights_schema(
    names: Sequence[str],
    provenance: dict[str, str],
    values: Sequence[Signal] = VALUES,
    table: Parameters = OURS,
    ends: Outcomes = OUTCOMES,
) -> pa.Schema:
    """Schema of the flights table with the sample columns ``names`` and those of ``values``."""
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
            "what failed, or was to fail before the mission's end; or 'none'",
        ),
        *(make_input_field(table[name]) for name in names),
        *map(_value_field, values),
    ]
    return pa.schema(fields, metadata={f"abhv_mc.{key}": text for key, text in provenance.items()})


def write_parquet(
    path: Path, table: pa.Table, floats: Sequence[str], words: list[str], **more: Any
) -> None:
    """Floats byte by byte, dictionaries of words only, light compression: half the size of Parquet's defaults."""
    write_pieces(path, table.schema, [table], floats, words, **more)


def write_pieces(
    path: Path,
    schema: pa.Schema,
    pieces: Iterable[pa.Table],
    floats: Sequence[str],
    words: list[str],
    **more: Any,
) -> None:
    """The same for a table that comes in pieces, each of them a row group."""
    encoding = dict.fromkeys(floats, "BYTE_STREAM_SPLIT")
    options = {"compression": "zstd", "compression_level": 1, "write_page_checksum": True, **more}

    def write(temporary: Path) -> None:
        with pq.ParquetWriter(
            temporary, schema, use_dictionary=words, column_encoding=encoding, **options
        ) as writer:
            for piece in pieces:
                writer.write_table(piece)

    write_whole(path, write)


def block_path(folder: Path, controller: str, first: int, stop: int) -> Path:
    """Name of a block's file: the controller and the flights first .. stop - 1."""
    return folder / f"{controller}-{first:09d}-{stop:09d}.parquet"


def parse_block_name(path: Path) -> tuple[str, int, int]:
    """Controller, first and stop from a block's file name. Raises DamagedFileError."""
    controller, _, rest = path.stem.rpartition("-")
    controller, _, first = controller.rpartition("-")
    if not (controller and first.isdecimal() and rest.isdecimal() and (first + rest).isascii()):
        raise DamagedFileError(f"{path.name} is no block's name")
    return controller, int(first), int(rest)


def write_block(folder: Path, rows: FlightRows, schema: pa.Schema) -> Digest:
    """Write one block's file into ``folder`` and give its digest."""
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
    """Return a reason as one line of valid text."""
    return " ".join(reason.encode(errors="replace").decode().split())[:_LONGEST]


def write_rows(path: Path, schema: pa.Schema, pieces: Iterable[pa.Table], digest: Digest) -> None:
    """Write a file of flights whose rows come in pieces."""
    schema = schema.with_metadata({**(schema.metadata or {}), _DIGEST: str(digest)})
    floats = [field.name for field in schema if pa.types.is_floating(field.type)]
    cast = (piece.replace_schema_metadata(schema.metadata) for piece in pieces)
    write_pieces(
        path,
        schema,
        cast,
        floats,
        ["controller", "outcome", REASON, CASE],
        write_statistics=["flight"],
    )


def read_digest(path: Path) -> Digest:
    """What a block's file says of its rows."""
    return Digest(int((pq.read_schema(path).metadata or {})[_DIGEST], 16))


def read_pieces(path: Path, names: Sequence[str]) -> Iterator[tuple[FlightRows, Digest]]:
    """The rows of a block's file, a row group at a time, each with its digest.

    Raises DamagedFileError, at the end at the latest, where they are not whole.
    """
    controller, first, stop = parse_block_name(path)
    digest = Digest()
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            for group in range(file.num_row_groups):
                table = file.read_row_group(group)
                rows = _take_rows(table, controller, first, names)
                if not np.array_equal(column_values(table["flight"]), rows.flights):
                    break
                one = rows.digest()
                digest, first = digest + one, rows.stop
                yield rows, one
            expected = (file.schema_arrow.metadata or {}).get(_DIGEST, b"").decode()
    except (pa.ArrowException, OSError, KeyError, ValueError) as error:
        if is_exhausted(error):
            raise
        raise DamagedFileError(f"{path.name}: {str(error).splitlines()[0]}") from error
    if first != stop or str(digest) != expected:
        raise DamagedFileError(f"{path.name} does not hold what was written")


def _take_rows(table: pa.Table, controller: str, first: int, names: Sequence[str]) -> FlightRows:
    sampled = [column_values(table[name]) for name in names]
    samples = np.stack(sampled, axis=1) if names else np.empty((table.num_rows, 0))
    held = table.column_names
    columns = tuple(name for name in held[held.index(CASE) + 1 :] if name not in names)
    values = np.stack([column_values(table[name]) for name in columns], axis=1)
    return FlightRows(
        controller,
        first,
        tuple(names),
        samples,
        tuple(table["outcome"].to_pylist()),
        values,
        columns,
        reasons=tuple(table[REASON].to_pylist()) if REASON in held else (),
    )
