"""Speed of the compiled flight: batched, alone, on two workers, and against what the core can do.

Times of one core are the thread's own, so that other programs on the machine count for little; two workers are
measured by the clock on the wall. The measurements take turns, so that a machine that slows down slows all of them.
"""

import json
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flight.fly import fly
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.flight.prepare import prepare
from abhv_mc.kernel.flight.interface import LANES
from abhv_mc.kernel.jit import kernel
from abhv_mc.shipped import shipped_campaigns

_NUMBERS = 128
_OPERATIONS = 16  # on each number in each sweep
_SWEEPS = 40_000


@kernel
def multiply_and_add(x, factor, addend, sweeps):  # type: ignore[no-untyped-def]
    """Eight times ``factor * x + addend`` in place on every number of ``x``, ``sweeps`` times over."""
    half = x.size // 2
    for _ in range(sweeps):
        for i in range(half):
            v, w = x[i], x[i + half]  # two vectors at a time: one after another, a core waits for the results
            for _ in range(8):
                v = v * factor + addend
                w = w * factor + addend
            x[i], x[i + half] = v, w


def measure_peak() -> float:
    """Additions and multiplications per second of one core now; some milliseconds of work."""
    x = np.linspace(0.0, 1.0, _NUMBERS)
    multiply_and_add(x, 0.5, 0.25, 1)  # compiles, or loads
    start = time.thread_time()
    multiply_and_add(x, 0.5, 0.25, _SWEEPS)
    return _NUMBERS * _OPERATIONS * _SWEEPS / (time.thread_time() - start)


CONTROLLERS = ("tlc", "lqr")
OPERATIONS_FILE = Path(__file__).with_name("operations.json")  # counted by benchmarks/operations.py
_ALONE = 4  # flights one at a time in a repetition


@dataclass(frozen=True)
class Operations:
    """Floating-point operations of one flight from start to end."""

    additions: float
    multiplications: float
    divisions: float
    square_roots: float

    @property
    def total(self) -> float:
        """All of them, each as one."""
        return self.additions + self.multiplications + self.divisions + self.square_roots


def read_operations() -> dict[str, Operations]:
    """Of each controller's flight of the default campaign."""
    return {name: Operations(**counts) for name, counts in json.loads(OPERATIONS_FILE.read_text("utf-8")).items()}


@dataclass(frozen=True)
class ControllerSpeed:
    """One controller's flights on one core."""

    seconds: float  # a flight, flown in a batch
    alone_seconds: float  # a flight, one at a time
    operations: Operations

    def times_the_floor(self, peak: float) -> float:
        """Time over what the operations alone take at ``peak`` operations per second."""
        return self.seconds * peak / self.operations.total


@dataclass(frozen=True)
class Speed:
    """What :func:`measure_speed` found."""

    peak: float  # additions and multiplications per second and core
    controllers: dict[str, ControllerSpeed]
    two_workers_over_one: float
    plan: FlightPlan  # of one of them
    flights: int  # of each controller, flown in batches


def measure_speed(repetitions: int, flights: int = 64) -> Speed:
    """Medians of ``repetitions`` flights of the default campaign, ``flights`` at a time.

    ``flights`` should be a multiple of the lanes, so that none flies empty.
    """
    plans, parameters = make_work(flights)
    operations = read_operations()
    for plan in plans.values():
        fly(plan, parameters[:LANES])
        fly(plan, parameters[:1], lanes=1)
    peaks: list[float] = []
    batched: dict[str, list[float]] = {name: [] for name in plans}
    alone: dict[str, list[float]] = {name: [] for name in plans}
    gains: list[float] = []
    for _ in range(repetitions):
        for name, plan in plans.items():
            peaks.append(measure_peak())
            batched[name].append(_time(plan, parameters, LANES) / flights)
            alone[name].append(_time(plan, parameters[:_ALONE], 1) / _ALONE)
        gains.append(_gain_of_two(next(iter(plans.values())), parameters))
    return Speed(
        median(peaks),
        {name: ControllerSpeed(median(batched[name]), median(alone[name]), operations[name]) for name in plans},
        median(gains),
        next(iter(plans.values())),
        flights * repetitions,
    )


def make_work(flights: int) -> tuple[dict[str, FlightPlan], Floats]:
    """Plans of `harder_vehicle`, the campaign that speed is recorded of, and the parameters of its first flights."""
    campaign = read_campaign(shipped_campaigns() / "harder_vehicle.yaml")
    model = campaign.model
    plans = {name: prepare(model.vehicle, model.mission, model.controllers[name], name) for name in CONTROLLERS}
    samples = campaign.make_samples()
    return plans, campaign.rows(samples.draw(0, flights))


def _time(plan: FlightPlan, parameters: Floats, lanes: int) -> float:
    start = time.thread_time()
    fly(plan, parameters, lanes=lanes)
    return time.thread_time() - start


def _gain_of_two(plan: FlightPlan, parameters: Floats) -> float:
    """Flights per second of two threads over those of one, by the wall's clock."""
    with ThreadPoolExecutor(2) as pool:
        start = time.perf_counter()
        pool.submit(fly, plan, parameters).result()
        one = time.perf_counter() - start
        start = time.perf_counter()
        for flown in [pool.submit(fly, plan, parameters) for _ in range(2)]:
            flown.result()
        two = time.perf_counter() - start
    return 2.0 * one / two
