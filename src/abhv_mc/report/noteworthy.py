"""What a board has to know of each controller's flights beside its errors: saturation, limit cycles, early ends."""

from typing import Any

import numpy as np

from abhv_mc.report.flights import ControllerFlights
from abhv_mc.report.results import Results

_CYCLES = 5.0  # deg: ripple from which a flight is said to cycle
_SATURATION, _OUTSIDE, _RIPPLE = "surface_saturation_s", "outside_tables_s", "_ripple_deg"


def noteworthy_numbers(results: Results) -> dict[str, Any]:
    """Flights [count] of each controller whose surfaces saturate, that cycle by channel, that leave the tables."""
    return {name: _of(results.flights[name]) for name in results.controllers}


def _of(flights: ControllerFlights) -> dict[str, Any]:
    def above(metric: str, limit: float) -> int | None:
        return int(np.sum(flights.metrics[metric] > limit)) if metric in flights.metrics else None

    cycling = {metric.removesuffix(_RIPPLE): above(metric, _CYCLES) for metric in flights.metrics if _RIPPLE in metric}
    return {
        "flown": int(flights.flight.size),
        "saturated": above(_SATURATION, 0.0),
        "outside_tables": above(_OUTSIDE, 0.0),
        "cycling": cycling,
        "ripple_deg": _CYCLES,
    }
