"""The benchmark's record: its fields, and that its ratios follow from its measurements."""

import json

import numpy as np
import pytest

from abhv_mc.bench.json_record import make_figures
from abhv_mc.bench.speed import ControllerSpeed, Operations, Speed, make_work, multiply_and_add
from abhv_mc.bench.start_times import Start, _peak_memory
from abhv_mc.cli.proving import bench

OPERATIONS = Operations(additions=10e6, multiplications=20e6, divisions=1e6, square_roots=1e6)


@pytest.fixture(scope="module")
def speed():
    """Figures that are easy to check."""
    one = ControllerSpeed(seconds=2e-3, alone_seconds=8e-3, operations=OPERATIONS)
    return Speed(64e9, {"tlc": one, "lqr": one}, 1.9, make_work(1)[0]["tlc"], 640)


def test_fields_and_ratios(speed):
    figures = make_figures(speed, Start(cold=20.0, warm=1.0, importing=0.01, peak_memory=500.0))
    assert figures["controllers"]["lqr"] == {
        "flights_per_second_per_core": 500.0,
        "ms_per_flight": 2.0,
        "one_at_a_time_ms": 8.0,
        "batched_over_one": 4.0,
        "flops_per_flight": 32_000_000,
        "times_the_floor": 4.0,  # 32 M at 64 G a second: 0.5 ms
    }
    assert figures["machine"].keys() == {"cpu", "cores", "simd"} and figures["machine"]["cores"] >= 1
    assert (figures["peak_gflops_per_core"], figures["two_workers_over_one"], figures["flights"]) == (64.0, 1.9, 640)
    assert (figures["cold_start_s"], figures["warm_start_s"], figures["peak_memory_mb"]) == (20.0, 1.0, 500.0)


def test_the_command_prints_a_table_and_writes_the_record(speed, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("abhv_mc.bench.speed.measure_speed", lambda repetitions: speed)
    monkeypatch.setattr("abhv_mc.bench.start_times.measure_start", lambda repetitions: Start(20.0, 1.0, 0.01, 500.0))
    bench(json=tmp_path / "bench.json", repetitions=1)
    assert json.loads((tmp_path / "bench.json").read_text())["two_workers_over_one"] == 1.9
    out = capsys.readouterr().out
    assert "500 flights per second and core" in out and "20.00 M multiplications" in out


def test_the_yardstick_does_the_arithmetic_that_it_counts():
    x = np.linspace(-1.0, 1.0, 128)
    expected = x.copy()
    for _ in range(3 * 8):
        expected = expected * 0.3 + 0.1
    multiply_and_add(x, 0.3, 0.1, 3)
    assert np.array_equal(x, expected)  # a fused multiply-add would round once, not twice


def test_peak_memory_is_that_of_the_process():
    small, large = (_peak_memory(["-c", f"x = b'1' * {size}"]) for size in (1, 200_000_000))
    assert small < 100.0 and large - small == pytest.approx(200.0, rel=0.15)  # not that of its parent
