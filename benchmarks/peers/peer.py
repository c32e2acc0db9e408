"""What the peers that fly our equations share: one process measures one peer and prints one line of JSON."""

import json
import pickle
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from abhv_mc.array_types import Floats
from abhv_mc.flight.plan import FlightPlan


class Work(NamedTuple):
    """The flights that every peer flies, computed once."""

    plans: dict[str, FlightPlan]  # by controller
    parameters: Floats  # [flight, parameter]
    final_states: Floats  # [flight, state] of ours under LQR
    repeats: int


def read_work() -> Work:
    """The work that ``run.py`` wrote for its own peers: its path is the first argument."""
    return Work(*pickle.loads(Path(sys.argv[1]).read_bytes()))  # noqa: S301  # written by the same run


def measure(fly: Callable[[], Any], flights: int, repeats: int) -> list[float]:
    """Seconds of processor time per flight, each time anew."""
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        fly()
        seconds.append((time.process_time() - start) / flights)
    return seconds


def write_result(name: str, seconds: list[float], **more: Any) -> None:
    """One line of JSON to standard output."""
    print(json.dumps({"peer": name, "seconds": seconds, **more}), flush=True)
