"""A controller's metric in the sense of `abhv_mc.statistics`: larger is worse, a flight that failed is worst."""

from typing import Any

import numpy as np

from abhv_mc.report.columns import Floats
from abhv_mc.report.flights import ControllerFlights
from abhv_mc.report.metrics import words_of
from abhv_mc.statistics.estimates import severity


def severities(flights: ControllerFlights, metric: str, rows: Any = slice(None)) -> Floats:
    """Severities [flight] of a metric; of all flights, or of those in `rows`."""
    return severity(flights.metrics[metric][rows], words_of(metric).sense, flights.failed[rows])


def common_rows(a: ControllerFlights, b: ControllerFlights) -> tuple[Any, Any]:
    """Rows of the flights that both flew, so that row i of one is the same flight as row i of the other."""
    _, rows_a, rows_b = np.intersect1d(a.flight, b.flight, assume_unique=True, return_indices=True)
    return rows_a, rows_b
