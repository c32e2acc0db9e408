"""Nominal flights in a folder: their history as Parquet, and a sheet of their channels."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.plan import FlightPlan


def write_nominal_report(
    folder: Path, plans: Mapping[str, FlightPlan], histories: Mapping[str, NDArray[np.float32]]
) -> Iterator[Path]:
    """Write ``nominal.parquet``, ``reference.parquet`` and ``figures/channels.png``; name what was written.

    ``histories`` holds each controller's flight ``[tick, channel]``, recorded at every tick.
    """
    import pyarrow.parquet as pq

    from abhv_mc.folder.histories import write_nominal, write_reference
    from abhv_mc.io.parquet_columns import column_values
    from abhv_mc.simulators.make_plans import reference_of
    from abhv_mc.topics.envelopes.figures import plot_flown
    from abhv_mc.topics.figure_style import write_png
    from abhv_mc.topics.names import controller_label

    plan = next(iter(plans.values()))
    times = np.arange(plan.timing.ticks + 1).astype(np.float64) * plan.timing.tick
    write_nominal(folder / "nominal.parquet", times, dict(histories))
    yield folder / "nominal.parquet"
    write_reference(folder / "reference.parquet", reference_of(plan, 1))
    yield folder / "reference.parquet"
    flights = {
        name: {"time": times} | {channel: history[:, i].astype(np.float64) for channel, i in CHANNEL_INDEX.items()}
        for name, history in histories.items()
    }
    table = pq.ParquetFile(folder / "reference.parquet").read()
    reference = {name: column_values(table[name]) for name in table.column_names}
    picture = folder / "figures" / "channels.png"
    write_png(plot_flown(flights, reference, {name: controller_label(name) for name in flights}), picture)
    yield picture
