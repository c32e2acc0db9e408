"""The benchmark's record: that its ratios follow from its measurements, and its table from the record."""

import json

import numpy as np
import pytest

from abhv_mc.bench.speed import _peak_memory, compare_speeds, multiply_and_add, read_operations
from abhv_mc.cli.proving import bench

OPERATIONS = {"additions": 10e6, "multiplications": 20e6, "divisions": 1e6, "square_roots": 1e6}


def test_the_ratios_and_the_table(monkeypatch, tmp_path, capsys):
    one = compare_speeds(2e-3, 8e-3, 64e9, OPERATIONS)
    assert one == {
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
        "controllers": {"tlc": one},
    }
    speed |= {"two_workers_over_one": 1.9, "step_s": 0.01, "control_rate_hz": 100.0, "flights": 640}
    starts = {"cold_start_s": 20.0, "warm_start_s": 1.0, "import_s": 0.01, "peak_memory_mb": 500.0}
    monkeypatch.setattr("abhv_mc.bench.speed.measure_speed", lambda repetitions: speed)
    monkeypatch.setattr("abhv_mc.bench.speed.measure_start", lambda repetitions: starts)
    bench(json=tmp_path / "bench.json", repetitions=1)
    assert json.loads((tmp_path / "bench.json").read_text()) == speed | starts
    out = capsys.readouterr().out
    million = read_operations()["tlc"]["multiplications"] / 1e6
    assert "500 flights per second and core" in out and f"{million:.2f} M multiplications" in out


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
