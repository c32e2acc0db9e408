"""Shared code of the peers; one process measures one peer and prints one line of JSON."""

import json
import pickle
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.flight.plan import FlightPlan


class Work(NamedTuple):
    """Flights that every peer simulates, computed once."""

    plans: dict[str, FlightPlan]  # by controller
    parameters: Floats  # [flight, parameter]
    final_states: Floats  # [flight, state] of abhv-mc with LQR
    repeats: int


def read_work() -> Work:
    """Read the work that ``run.py`` wrote; its path is the first argument."""
    return Work(*pickle.loads(Path(sys.argv[1]).read_bytes()))  # noqa: S301  # written by the same run


def measure(fly: Callable[[], Any], flights: int, repeats: int) -> list[float]:
    """Return the processor time per flight of each repetition, s."""
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        fly()
        seconds.append((time.process_time() - start) / flights)
    return seconds


def write_result(name: str, seconds: list[float], **numbers: Any) -> None:
    """Print one line of JSON to standard output."""
    print(json.dumps({"peer": name, "seconds": seconds, **numbers}), flush=True)
