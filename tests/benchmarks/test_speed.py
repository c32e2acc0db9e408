"""Tests of the benchmark of speed: its record, counted operations, and C++ twin."""

import json
import math
import re
import shutil

import numpy as np
import pytest

from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import RATE_LIMIT
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.plant.parameters import PARAMETERS
from benchmarks.bench import bench
from benchmarks.counted import COUNTS, Counted, counted_sqrt
from benchmarks.operations import count_operations
from benchmarks.peers.twin import compile_twin, fly_twin
from benchmarks.speed import (
    _peak_memory,
    compare_speeds,
    make_work,
    multiply_and_add,
    read_operations,
)

OPERATIONS = {"additions": 10e6, "multiplications": 20e6, "divisions": 1e6, "square_roots": 1e6}


def test_ratios_record_and_table(monkeypatch, tmp_path, capsys):
    speeds = compare_speeds(2e-3, 8e-3, 64e9, OPERATIONS)
    assert speeds == {
        "flights_per_second_per_core": 500.0,
        "ms_per_flight": 2.0,
        "one_at_a_time_ms": 8.0,
        "batched_over_one": 4.0,
        "flops_per_flight": 32_000_000,
        "times_the_floor": 4.0,  # 32 M at 64 G a second: 0.5 ms
    }
    speed = {
        "machine": {"cpu": "x", "cores": 2, "simd": "AVX2"},
        "peak_gflops_per_core": 64.0,
        "controllers": {"tlc": speeds},
    }
    speed |= {"two_workers_over_one": 1.9, "step_s": 0.01, "control_rate_hz": 100.0, "flights": 640}
    starts = {"cold_start_s": 20.0, "warm_start_s": 1.0, "import_s": 0.01, "peak_memory_mb": 500.0}
    monkeypatch.setattr("benchmarks.speed.measure_speed", lambda repetitions: speed)
    monkeypatch.setattr("benchmarks.speed.measure_start", lambda repetitions: starts)
    bench(json=tmp_path / "bench.json", repetitions=1)
    assert json.loads((tmp_path / "bench.json").read_text()) == speed | starts
    out = capsys.readouterr().out
    million = read_operations()["tlc"]["multiplications"] / 1e6
    assert re.search(r"(?m)^ *500 ", out) and f"{million:.2f} M multiplications" in out


def test_the_peak_measurement_does_the_counted_arithmetic():
    x = np.linspace(-1.0, 1.0, 128)
    expected = x.copy()
    for _ in range(3 * 8):
        expected = expected * 0.3 + 0.1
    multiply_and_add(x, 0.3, 0.1, 3)
    assert np.array_equal(x, expected)  # a fused multiply-add would round once, not twice


def test_peak_memory_is_that_of_the_process():
    small, large = (_peak_memory(["-c", f"x = b'1' * {size}"]) for size in (1, 200_000_000))
    assert small < 100.0 and large - small == pytest.approx(
        200.0, rel=0.15
    )  # without the memory of its parent


@pytest.mark.parametrize("other", [3.0, np.float64(3.0), 3, Counted(3.0)])
def test_arithmetic_operations_count_once_and_other_operations_do_not(other):
    COUNTS.clear()
    x = Counted(2.0)
    results = [
        x + other,
        other + x,
        x - other,
        other - x,
        x * other,
        other * x,
        x / other,
        other / x,
    ]
    assert results == [5.0, 5.0, -1.0, 1.0, 6.0, 6.0, 2.0 / 3.0, 1.5]
    assert all(isinstance(result, Counted) for result in results)
    assert (-x, abs(x), min(x, 1.0), int(x), x < 1.0, math.isnan(x)) == (
        -2.0,
        2.0,
        1.0,
        2,
        False,
        False,
    )
    assert counted_sqrt(abs(x * 2.0)) * 1.0 == 2.0
    assert COUNTS == {"additions": 4, "multiplications": 4, "divisions": 2, "square_roots": 1}
    with pytest.raises(TypeError, match="products"):
        x**2.0


def test_the_stored_counts_are_up_to_date():
    COUNTS.clear()
    assert count_operations(make_work(1)[0]) == read_operations(), (
        "count again: python -m benchmarks.operations"
    )


FLIGHTS = 4
FACTOR = 0.03
SLOW = 0.1
HALF_WIDTH = {
    "m": 0.02,
    "m/s": 3.0,
    "1/s": 1e-4,
    "rad": 0.002,
    "rad/s": 0.001,
}  # of what adds, by unit
# m, m/s, rad, kg over 60 s: rounding and libm; 2e-10 found. Promised are 1e-6 m of altitude.
AGREEMENT = 1e-8


def disperse():
    """Draw all dispersions of the twin; the surfaces of the last flight reach their rate limit."""
    generator = np.random.default_rng(5)
    parameters = nominal_parameters(FLIGHTS)
    for i, parameter in enumerate(PARAMETERS[: PARAMETER_INDEX["sensor.yaw_rate_bias"] + 1]):
        width = HALF_WIDTH.get(parameter.unit, FACTOR if parameter.nominal else 2e-4)
        parameters[:, i] += generator.uniform(-width, width, FLIGHTS)
    parameters[:, PARAMETER_INDEX["one"]] = 1.0
    parameters[-1, PARAMETER_INDEX["actuator.rate_limit"]] = SLOW
    return parameters


@pytest.mark.skipif(shutil.which("g++") is None, reason="no g++")
def test_the_twin_simulates_the_same_flights_and_rejects_unsupported_dispersions(tmp_path):
    """Speeds are comparable only if the flights agree."""
    twin, plan = (
        compile_twin(tmp_path),
        make_flight_plan("s_manoeuvre", "ghame_x", controller="lqr"),
    )
    parameters = disperse()
    ours = fly(plan, parameters, record_every=1, keep_states=True)
    assert ours.outcome.tolist() == [Outcome.OK] * FLIGHTS
    limit = SLOW * plan.vehicle.actuators[0, RATE_LIMIT]
    assert np.abs(ours.states[-1, :, s.AILERON_RATE]).max() == pytest.approx(limit, rel=1e-12)
    _, states = fly_twin(twin, plan, parameters, ours.states[:, 0], keep=FLIGHTS)
    assert np.abs(states - ours.states).max() < AGREEMENT
    parameters[0, PARAMETER_INDEX["wind.turbulence"]] = 1.0
    with pytest.raises(ValueError, match=r"wind\.turbulence"):
        fly_twin(twin, plan, parameters, ours.states[:, 0])
