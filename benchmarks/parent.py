"""Work of the launching process per flight, and the number of workers that it can supply.

    python -m benchmarks.parent [--flights N] [--files N] [--json FILE]

A batch is simulated once. Every block of a campaign after 4096 flights consists of pickled copies
of this batch, which arrive after the time that a core takes to compute them, plus or minus 20 %. A
campaign of 64 workers thus runs on any machine, without the network. With few workers, each worker
is up to eight times as fast, so that the launching process has the work of 64 workers. The script
prints its processor time per flight, and the flights per second by number of workers.
"""

import argparse
import contextlib
import io
import json
import pickle
import random
import resource
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from abhv_mc.execution import runner
from abhv_mc.execution.attestation import sign
from abhv_mc.execution.executor import FlightRunner
from abhv_mc.requests import Request
from abhv_mc_vehicle.vehicle_simulator.simulator import make_engine

CAMPAIGN = Path(__file__).parents[1] / "campaigns" / "harder_vehicle.yaml"
WORKERS = (1, 2, 8, 32, 64)
_BLOCK = 8192  # flights of one
FLIGHT = 1.25e-3  # s of a core for a flight, TLC and LQR mixed


class CannedWorkers:
    """Workers that return blocks computed before, to any number of threads."""

    def __init__(self, fly: Any, seconds: float) -> None:
        self._fly, self._seconds = fly, seconds  # of a flight
        self._canned: dict[tuple[int, int], bytes] = {}
        self._lock, self._spread = threading.Lock(), random.Random(1)

    def fly(self, plan: Any, parameters: np.ndarray, recorded: Any = None) -> Any:
        """Return a block of the same number of flights; recorded flights are simulated."""
        if recorded is not None:
            return self._fly(plan, parameters, recorded)
        key, start = (id(plan), len(parameters)), time.perf_counter()
        with self._lock:
            if key not in self._canned:
                self._canned[key] = self._can(plan, parameters)
                start = time.perf_counter()
        sent = pickle.dumps((parameters, recorded), pickle.HIGHEST_PROTOCOL)
        taken = self._seconds * len(parameters) * self._spread.uniform(0.8, 1.2)
        time.sleep(max(0.0, taken - (time.perf_counter() - start) * bool(sent)))
        return pickle.loads(self._canned[key])  # noqa: S301

    def _can(self, plan: Any, parameters: np.ndarray) -> bytes:
        few = self._fly(plan, parameters[:64], None)
        parts = {name: getattr(few, name) for name in few.__dataclass_fields__}
        for name in ("outcome", "end_time", "metrics", "history"):
            parts[name] = np.resize(parts[name], (len(parameters), *parts[name].shape[1:]))
        return pickle.dumps(sign(type(few)(**parts)), pickle.HIGHEST_PROTOCOL)


def run(
    flights: int, workers: int, seconds: float, out: Path | None = None, laws: Any = ("tlc", "lqr")
) -> Any:
    """Return processor and wall time per flight in the middle half of a campaign, s.

    All copied blocks exist by then.
    """
    engine = make_engine()
    crew, marks = CannedWorkers(engine.fly, seconds), []
    keep = runner._Run._keep

    @contextlib.contextmanager
    def open_canned(*_: Any) -> Iterator[FlightRunner]:
        yield FlightRunner(crew.fly, workers)

    def keep_and_mark(self: Any, block: Any, flown: Any) -> None:
        keep(self, block, flown)
        marks.append((block.flights, time.process_time(), time.perf_counter()))

    with (
        mock.patch.object(runner, "open_executor", open_canned),
        mock.patch.object(runner._Run, "_keep", keep_and_mark),
        tempfile.TemporaryDirectory() as folder,
        contextlib.redirect_stderr(io.StringIO()),
    ):
        runner.run_campaign(
            Request(CAMPAIGN, out or Path(folder) / "out", flights, None, laws, workers), engine
        )
    half = marks[len(marks) // 4 : 3 * len(marks) // 4 + 1]
    number = sum(count for count, _, _ in half[1:])
    return (half[-1][1] - half[0][1]) / number, (half[-1][2] - half[0][2]) / number


def count_files(flights: int) -> None:
    """Print the number of files of a campaign of one controller, and its cost."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        own, _ = run(flights, 2, 0.0, Path(folder) / "out", ("tlc",))
        files = len(list(Path(folder).rglob("*.parquet")))
        size = (Path(folder) / "out" / "manifest.json").stat().st_size
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        print(
            f"{flights} flights: {files} data files, a manifest of {size} bytes, "
            f"{time.perf_counter() - start:.0f} s"
        )
        print(f"{1e3 * own:.4f} ms of processor time a flight, {memory:.0f} MB at most")


def main() -> None:
    """Print the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--flights", type=int, default=131_072, help="of each controller, for the launching process"
    )
    parser.add_argument(
        "--files", type=int, help="flights of a campaign whose files are counted, and nothing else"
    )
    parser.add_argument("--json", type=Path)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    options = parser.parse_args()
    if options.smoke:
        print(run(2 * _BLOCK, 2, 0.0))
        return
    if options.files:
        count_files(options.files)
        return
    own, _ = run(options.flights, 2, 0.0)
    result: dict[str, Any] = {"ms_per_flight": 1e3 * own, "flights_per_second": {}}
    print(f"the launching process: {1e3 * own:.4f} ms of processor time a flight", flush=True)
    for workers in WORKERS:
        faster = max(1, min(8, WORKERS[-1] // workers))
        _, seconds = run(_BLOCK // 2 * max(32, 8 * workers), workers, FLIGHT / faster)
        result["flights_per_second"][workers] = rate = 1.0 / (faster * seconds)
        print(
            f"{workers:3d} workers: {rate:9.0f} flights/s, {rate * FLIGHT / workers:.2f} of "
            "their cores",
            flush=True,
        )
    if options.json:
        options.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
