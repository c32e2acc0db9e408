"""The envelopes of a campaign as Parquet: one row per controller, channel and recorded time."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.folder.flights import make_field, write_parquet

QUANTILES = (0.00135, 0.05, 0.50, 0.95, 0.99865)
QUANTILE_COLUMNS = ("q0.135", "q5", "q50", "q95", "q99.865")
_DOCS = {
    "min": "smallest value at any control tick from the time before to the time after",
    "max": "largest value at any control tick from the time before to the time after",
} | {name: f"{name[1:]} % quantile over the flights, linear between order statistics" for name in QUANTILE_COLUMNS}


@dataclass(frozen=True)
class EnvelopeTable:
    """Envelopes of one controller, ``[time, channel]`` each."""

    count: NDArray[np.int64]  # flights still flying
    low: Floats
    high: Floats
    quantiles: Floats  # [quantile, time, channel]


def write_envelopes(
    path: Path, times: Floats, channels: Sequence[str], tables: dict[str, EnvelopeTable], flights: int
) -> None:
    """Write the envelopes of every controller over its first ``flights`` flights, which the file's metadata say.

    ``channels`` are those of the tables' last axis.
    """
    shape = (len(channels), len(times))
    columns: dict[str, list[Floats]] = {name: [] for name in ("min", *QUANTILE_COLUMNS, "max")}
    counts = []
    for table in tables.values():
        parts = dict(zip(QUANTILE_COLUMNS, table.quantiles, strict=True))
        parts |= {"min": table.low, "max": table.high}
        for name, values in parts.items():
            columns[name].append(values.T.ravel())
        counts.append(table.count.T.ravel())
    fields = [
        make_field("controller", pa.string(), "-", "name of the controller"),
        make_field("channel", pa.string(), "-", "name of the channel; its unit ends the name"),
        make_field("time", pa.float64(), "s", "time since the start"),
        make_field("count", pa.int64(), "-", "flights still flying"),
        *(pa.field(name, pa.float64(), metadata={"unit": "of the channel", "doc": _DOCS[name]}) for name in columns),
    ]
    size = shape[0] * shape[1]
    arrays = [
        pa.array(np.repeat(list(tables), size)),
        pa.array(np.tile(np.repeat(channels, len(times)), len(tables))),
        pa.array(np.tile(times, shape[0] * len(tables))),
        pa.array(np.concatenate(counts)),
        *(pa.array(np.concatenate(parts)) for parts in columns.values()),
    ]
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields, {"flights": str(flights)}))
    write_parquet(path, table, ["time", *columns], ["controller", "channel"])
