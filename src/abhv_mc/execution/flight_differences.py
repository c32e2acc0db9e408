"""Differences between flights of a custom simulator with the same inputs."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.repeatability import relative_difference

ESTIMATES = "requirements get estimates instead of verdicts"  # last clause of warnings


class Difference(NamedTuple):
    """Largest relative difference between flights with the same inputs."""

    size: float = 0.0
    description: str = ""


def find_difference(
    campaign: Experiment, name: str, pairs: Iterable[tuple[Floats, Floats, Floats]]
) -> Difference:
    """Return the largest difference, which is infinite if outcomes differ.

    Each of ``pairs`` contains a row of inputs, and the values of two flights of the system ``name``
    with these inputs.
    """
    largest, labels = Difference(), ("outcome", *(metric.name for metric in campaign.measured))
    for row, a, b in pairs:
        sizes = relative_difference(a, b)
        sizes[0] = 0.0 if a[0] == b[0] else np.inf
        i = int(np.argmax(sizes))
        if sizes[i] > largest.size:
            values = f"{a[i]:.10g} and {b[i]:.10g}"
            if i == 0:
                values = " and ".join(campaign.outcomes.of(np.array([a[0], b[0]], np.int64)))
            inputs = ", ".join(
                f"{key} {value:.6g}"
                for key, value in zip(campaign.inputs, row.tolist(), strict=True)
            )
            description = f"'{name}' returns {labels[i]} {values} for the same inputs ({inputs})"
            largest = Difference(float(sizes[i]), description)
    return largest


def outcome_and_metrics(block: FlightBlock) -> Floats:
    """Return the outcome and metrics of each flight [flight, value]."""
    return np.column_stack([block.outcome.astype(np.float64), block.metrics])
