"""What the peers that fly our equations share: one process measures one peer and prints one line of JSON."""

import json
import pickle
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

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


def main(make_fly: Callable[[FlightPlan], Callable[[Floats], Floats]], name: str) -> None:
    """Measure a peer that flies ``parameters`` [flight, parameter] under LQR to final states [flight, state]."""
    work = read_work()
    fly = make_fly(work.plans["lqr"])
    start = time.process_time()
    final = fly(work.parameters)
    first = time.process_time() - start
    difference = float(np.abs(final[:, 0] - work.final_states[:, 0]).max())
    seconds = measure(lambda: fly(work.parameters), len(work.parameters), work.repeats)
    write_result(name, seconds, altitude_difference_m=difference, first_call_s=first)
