"""Parquet files of time histories, nominal flights, the reference, and envelopes.

The file of envelopes has one row per controller, channel and recorded time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from abhv_mc.array_types import Floats, Ints, Mask, Singles
from abhv_mc.flights.signals import Signal
from abhv_mc.folder.flights import make_field, write_pieces
from abhv_mc.io.parquet_columns import number_column, text_column
from abhv_mc.statistics.bands import QUANTILES

_TIME = make_field("time", pa.float64(), "s", "time since the start")
_CONTROLLER = make_field("controller", pa.string(), "-", "name of the controller")
_FLIGHT = make_field("flight", pa.int64(), "-", "number of the flight")
_SINGLE = pa.float32()
QUANTILE_COLUMNS = ("q0.135", "q5", "q50", "q95", "q99.865")
_CHANNEL_DOC = (
    "name of the channel, which ends with the unit; bands of angles are continuous and may exceed "
    "a full turn, and are NaN where the flights spread over the circle"
)
MOST_MEDIAN = "q50_most"  # upper edge of the median, which is a band if parameters are unknown
_DOCS = {
    name: (
        f"{adjective} value at any control tick or returned sample between the previous and the "
        "next time, but of angles at the time"
    )
    for name, adjective in (("min", "smallest"), ("max", "largest"))
} | {
    name: f"{name[1:]} % quantile over the flights, linear between order statistics"
    for name in QUANTILE_COLUMNS
}


def _metadata(**entries: str) -> dict[str, str]:
    return {f"abhv_mc.{name}": text for name, text in entries.items() if text}


def _channel_fields(signals: Sequence[Signal], kind: pa.DataType = _SINGLE) -> list[pa.Field]:
    return [make_field(signal.name, kind, signal.unit, signal.doc) for signal in signals]


def write_histories(
    path: Path,
    controller: str,
    flights: Sequence[int],
    times: Floats,
    history: Singles,
    *,
    channels: Sequence[str],
    metadata: dict[str, str] | None = None,
    recorded: Sequence[Signal],
) -> None:
    """Write ``channels`` of ``history[flight, time, channel]`` to a Parquet file.

    ``recorded`` lists the channels along the last axis of ``history``. A flight that terminated
    early has rows as long as its first channel is not NaN.
    """
    rows = ~np.isnan(history[:, :, 0])
    number, time = np.nonzero(rows)
    positions = {signal.name: i for i, signal in enumerate(recorded)}
    fields = [recorded[positions[name]] for name in channels]
    schema = pa.schema(
        [_FLIGHT, _CONTROLLER, _TIME, *_channel_fields(fields)], _metadata(**metadata or {})
    )
    columns = [
        number_column(np.asarray(flights, np.int64)[number]),
        text_column([controller] * len(number)),
        number_column(times[time]),
        *(number_column(history[:, :, positions[name]][rows]) for name in channels),
    ]
    table = pa.Table.from_arrays(columns, schema=schema)
    write_pieces(path, schema, [table], ["flight", "controller"])


def write_nominal(
    path: Path,
    times: Floats,
    nominal: dict[str, Singles],
    recorded: Sequence[Signal],
    key: str = "",
) -> None:
    """Write the ``recorded`` channels of the nominal flight [time, channel] of each controller."""
    fields = [_CONTROLLER, _TIME, *_channel_fields(recorded)]
    tables = []
    for controller, history in nominal.items():
        rows = ~np.isnan(history[:, 0])
        columns = [text_column([controller] * int(rows.sum())), number_column(times[rows])]
        columns += map(number_column, history[rows].T[: len(recorded)])
        tables.append(pa.Table.from_arrays(columns, schema=pa.schema(fields)))
    table = pa.concat_tables(tables).replace_schema_metadata(_metadata(key=key))
    write_pieces(path, table.schema, [table], ["controller"])


def write_reference(
    path: Path, reference: Mapping[str, Floats], signals: Sequence[Signal], key: str = ""
) -> None:
    """Write the reference trajectory: ``time`` and ``signals``, each [time]."""
    schema = pa.schema([_TIME, *_channel_fields(signals, pa.float64())], _metadata(key=key))
    table = pa.Table.from_arrays(
        [number_column(reference[name]) for name in schema.names], schema=schema
    )
    write_pieces(path, schema, [table], [])


@dataclass(frozen=True)
class EnvelopeTable:
    """Envelopes of one controller, each ``[time, channel]``.

    With unknown parameters, quantiles are computed over the flights at each point; ``least`` and
    ``most`` are the smallest and largest quantiles over all points.
    """

    count: Ints  # number of flights that have not ended
    low: Floats
    high: Floats
    least: Floats  # [quantile, time, channel]
    most: Floats

    def at(self, times: Mask) -> "EnvelopeTable":
        """Return the envelopes at selected times."""
        return EnvelopeTable(
            self.count[times],
            self.low[times],
            self.high[times],
            self.least[:, times],
            self.most[:, times],
        )

    def columns(self, points: int) -> dict[str, Floats]:
        """Return the columns of the Parquet file.

        The lower edge is used for quantiles up to the median, the upper edge for higher quantiles.
        """
        middle = len(QUANTILES) // 2
        edges = [*self.least[: middle + 1], *self.most[middle + 1 :]]
        named = {
            "min": self.low,
            **dict(zip(QUANTILE_COLUMNS, edges, strict=True)),
            "max": self.high,
        }
        return named | ({MOST_MEDIAN: self.most[middle]} if points > 1 else {})


def _doc(column: str, points: int) -> str:
    if points == 1 or column in ("min", "max"):
        return _DOCS[column]
    which = "least" if column in QUANTILE_COLUMNS[:3] else "most"
    doc = _DOCS[column.removesuffix("_most")]
    return f"{which} of the {points} values of the {doc} at the points of the unknowns"


def write_envelopes(
    path: Path,
    times: Floats,
    channels: Sequence[str],
    tables: dict[str, EnvelopeTable],
    flights: int,
    *,
    points: int = 1,
    key: str = "",
) -> None:
    """Write all controllers' envelopes, computed from the first ``flights`` flights.

    ``channels`` lists the channels along the last axis of the tables; ``points`` is the number of
    points of the unknown parameters.
    """
    shape = (len(channels), len(times))
    columns: dict[str, list[Floats]] = {}
    counts = []
    for table in tables.values():
        for name, values in table.columns(points).items():
            columns.setdefault(name, []).append(values.T.ravel())
        counts.append(table.count.T.ravel())
    fields = [
        _CONTROLLER,
        make_field("channel", pa.string(), "-", _CHANNEL_DOC),
        _TIME,
        make_field("count", pa.int64(), "-", "number of flights that have not ended"),
        *(
            pa.field(
                name, pa.float64(), metadata={"unit": "of the channel", "doc": _doc(name, points)}
            )
            for name in columns
        ),
    ]
    size = shape[0] * shape[1]
    arrays = [
        text_column(np.repeat(list(tables), size).tolist()),
        text_column(np.tile(np.repeat(channels, len(times)), len(tables)).tolist()),
        number_column(np.tile(times, shape[0] * len(tables))),
        number_column(np.concatenate(counts)),
        *(number_column(np.concatenate(parts)) for parts in columns.values()),
    ]
    metadata = {"flights": str(flights)} | _metadata(key=key)
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata))
    write_pieces(path, table.schema, [table], ["controller", "channel"])
