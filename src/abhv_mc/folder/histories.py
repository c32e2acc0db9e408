"""Histories of flights, the nominal flights and the reference as Parquet."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.channels import CHANNEL_INDEX, CHANNELS, REFERENCE_CHANNELS, Signal
from abhv_mc.folder.flights import make_field, write_parquet
from abhv_mc.io.parquet_columns import number_column, text_column

_TIME = make_field("time", pa.float64(), "s", "time since the start")
_CONTROLLER = make_field("controller", pa.string(), "-", "name of the controller")
_FLIGHT = make_field("flight", pa.int64(), "-", "number of the flight")


def write_histories(
    path: Path,
    controller: str,
    flights: Sequence[int],
    times: Floats,
    history: NDArray[np.float32],
    channels: Sequence[str],
    metadata: dict[str, str] | None = None,
    known: Sequence[Signal] = CHANNELS,
) -> None:
    """Write ``history[flight, time, channel]`` (all of the plan's) as rows of the named ones of its ``known`` channels.

    A flight that ended early has rows up to its end: those with a number in the first channel.
    """
    rows = ~np.isnan(history[:, :, 0])
    number, time = np.nonzero(rows)
    places = {signal.name: i for i, signal in enumerate(known)}
    fields = [known[places[name]] for name in channels]
    schema = pa.schema(
        [_FLIGHT, _CONTROLLER, _TIME, *(make_field(f.name, pa.float32(), f.unit, f.doc) for f in fields)],
        metadata={f"abhv_mc.{key}": text for key, text in (metadata or {}).items()},
    )
    columns = [
        number_column(np.asarray(flights, np.int64)[number]),
        text_column([controller] * len(number)),
        number_column(times[time]),
        *(number_column(history[:, :, places[name]][rows]) for name in channels),
    ]
    write_parquet(path, pa.Table.from_arrays(columns, schema=schema), ["time", *channels], ["flight", "controller"])


def history_metadata(path: Path) -> dict[str, str]:
    """What :func:`write_histories` was given as metadata."""
    metadata = pq.read_schema(path).metadata or {}
    prefix = b"abhv_mc."
    return {k.removeprefix(prefix).decode(): v.decode() for k, v in metadata.items() if k.startswith(prefix)}


def write_nominal(path: Path, times: Floats, nominal: dict[str, NDArray[np.float32]]) -> None:
    """Write each controller's nominal flight ``[time, channel]``."""
    fields = [_CONTROLLER, _TIME, *(make_field(s.name, pa.float32(), s.unit, s.doc) for s in CHANNELS)]
    tables = []
    for controller, history in nominal.items():
        rows = ~np.isnan(history[:, CHANNEL_INDEX["altitude_m"]])
        columns = [text_column([controller] * int(rows.sum())), number_column(times[rows])]
        columns += map(number_column, history[rows].T[: len(CHANNELS)])
        tables.append(pa.Table.from_arrays(columns, schema=pa.schema(fields)))
    write_parquet(path, pa.concat_tables(tables), ["time", *CHANNEL_INDEX], ["controller"])


def write_reference(path: Path, reference: Mapping[str, Floats]) -> None:
    """Write the mission's reference: ``time`` and REFERENCE_CHANNELS [time], in their units."""
    fields = [_TIME, *(make_field(signal.name, pa.float64(), signal.unit, signal.doc) for signal in REFERENCE_CHANNELS)]
    schema = pa.schema(fields)
    table = pa.Table.from_arrays([number_column(reference[name]) for name in schema.names], schema=schema)
    write_parquet(path, table, table.column_names, [])
