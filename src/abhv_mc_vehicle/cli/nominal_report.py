"""Files with the nominal flights of ``abhv-mc fly``."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from abhv_mc.folder.histories import write_nominal, write_reference
from abhv_mc.io.parquet_columns import column_values
from abhv_mc.statistics.circular import unwrap
from abhv_mc.topics.envelopes.figures import plot_flown
from abhv_mc.topics.figure_style import write_png
from abhv_mc.topics.topic import controller_label
from abhv_mc_vehicle.flight.channels import CHANNELS, REFERENCE_CHANNELS
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.vehicle_simulator.make_plans import reference_of


def write_nominal_report(
    folder: Path, plans: Mapping[str, FlightPlan], histories: Mapping[str, NDArray[np.float32]]
) -> Iterator[Path]:
    """Write nominal.parquet, reference.parquet and figures/channels.png; yield their paths.

    ``histories`` contains an array [tick, channel] per controller.
    """
    plan = next(iter(plans.values()))
    times = np.arange(plan.timing.ticks + 1).astype(np.float64) * plan.timing.tick
    shared = [c for c in plan.channels if all(c in other.channels for other in plans.values())]
    columns = {
        name: history[:, [plans[name].channels.index(c) for c in shared]]
        for name, history in histories.items()
    }
    write_nominal(folder / "nominal.parquet", times, columns, recorded=shared)
    yield folder / "nominal.parquet"
    write_reference(folder / "reference.parquet", reference_of(plan, 1), REFERENCE_CHANNELS)
    yield folder / "reference.parquet"
    flights = {
        controller_label(name): {"time": times}
        | {
            channel.name: unwrap(values.astype(np.float64), channel.period)
            for channel, values in zip(CHANNELS, history.T, strict=False)
        }
        for name, history in histories.items()
    }
    table = pq.ParquetFile(folder / "reference.parquet").read()
    reference = {name: column_values(table[name]) for name in table.column_names}
    picture = folder / "figures" / "channels.png"
    write_png(plot_flown(flights, reference), picture)
    yield picture
