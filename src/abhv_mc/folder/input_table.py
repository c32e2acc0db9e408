"""Inputs of a campaign's flights as a CSV file for another simulator."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.folder.samples import ROW_GROUP
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.csv_table import write_batches


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
        for first in range(0, source.flights, ROW_GROUP):
            stop = min(first + ROW_GROUP, source.flights)
            columns = [np.arange(first, stop), *source.draw(first, stop).T]
            arrays = [
                pa.array(column).cast(kind)
                for column, kind in zip(columns, schema.types, strict=True)
            ]
            yield pa.record_batch(arrays, schema=schema)

    with atomic_write(path) as temporary:
        write_batches(temporary, schema, batches())
    return source.flights
