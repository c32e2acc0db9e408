"""Ripple metrics against a numpy implementation of their definition, on signals and flights."""

from itertools import pairwise

import numpy as np
import pytest

from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.kernel.flight.ripple import (
    FREQUENCY,
    LARGEST,
    N_RIPPLE_ROWS,
    begin_stretch,
    change_side,
    keep_cycle,
    watch_sides,
)
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan

TICK = 0.01  # s


def farthest_points(stretch):
    """Return the tick of the farthest point on each side of the mean since the start.

    A side ends when the signal has gone half as far on the other side.
    """
    mean, points, begin, way = np.cumsum(stretch) / np.arange(1, stretch.size + 1), [], 0, 0.0
    while begin < stretch.size:
        rising = way * (stretch - mean)[begin:]
        top = np.maximum.accumulate(way * stretch[begin:])
        enough = -rising >= np.maximum(0.5 * (top - way * mean[begin:]), 0.01)
        if way == 0.0:
            enough = np.abs(stretch - mean) >= 0.01
        end = int(np.argmax(enough)) if enough.any() else stretch.size - begin
        if way:
            points.append(begin + int(np.argmax(top == top[end - 1])))
        begin += end
        way = float(np.sign((stretch - mean)[begin])) if begin < stretch.size else way
    return points


def expected_ripple(error, settled):
    """Return the size of the largest cycle and the frequency of each cycle of that size."""
    starts = np.flatnonzero(settled & ~np.concatenate([[False], settled[:-1]]))
    stops = np.flatnonzero(settled & ~np.concatenate([settled[1:], [False]])) + 1
    cycles = [(0.0, 0.0)]
    for start, stop in zip(starts, stops, strict=True):
        points = farthest_points(error[start:stop])
        swings = np.abs(np.diff(error[start:stop][points]))
        for i, (first, second) in enumerate(pairwise(swings.tolist())):
            if min(first, second) >= 0.5 * max(first, second):
                cycles.append((max(first, second), 1.0 / (TICK * (points[i + 2] - points[i]))))
    largest = max(cycles)[0]
    return largest, [frequency for size, frequency in cycles if size >= (1.0 - 1e-12) * largest]


def follow(error, settled):
    Z, seen = np.zeros((N_RIPPLE_ROWS + 1, 1)), 0
    begin_stretch(Z, 1, 0)
    for tick, (value, calm) in enumerate(zip(error.tolist(), settled.tolist(), strict=True)):
        Z[N_RIPPLE_ROWS, 0] = value
        seen = seen + 1 if calm else 0
        if seen == 1:
            keep_cycle(Z, 0, 0, TICK)
            begin_stretch(Z, 1, 0)
        if calm and watch_sides(Z, 1, 0, N_RIPPLE_ROWS, 1.0, 1.0 / seen, float(tick)):
            change_side(Z, 0, 0, value, float(tick), TICK)
    keep_cycle(Z, 0, 0, TICK)
    return Z[LARGEST, 0], Z[FREQUENCY, 0]


def zigzag(generator):
    """Straight lines between turning points, each swing a tenth to ten times the one before."""
    swings = [generator.uniform(0.5, 2.0)]
    for factor in 10.0 ** generator.uniform(-1.0, 1.0, 14):
        swings.append(
            np.clip(factor * swings[-1], max(0.01, 0.1 * swings[-1]), min(100.0, 10.0 * swings[-1]))
        )
    points = np.cumsum([generator.normal(), *swings * (-1.0) ** np.arange(len(swings))])
    return np.concatenate([np.linspace(a, b, 9)[:-1] for a, b in pairwise(points)])


@pytest.mark.parametrize("seed", range(40))
def test_ripple_follows_its_definition_on_random_signals(seed):
    generator = np.random.default_rng(seed)
    signals = (
        zigzag(generator),
        np.cumsum(generator.normal(size=600)),
        np.round(generator.normal(size=600), 1),
        np.sin(np.cumsum(generator.uniform(0.02, 0.06, 600)))
        * np.exp(generator.normal() * np.linspace(0.0, 2.0, 600)),
    )
    for error in signals:
        settled = np.repeat(generator.uniform(size=error.size // 8 + 1) < 0.95, 8)[: error.size]
        (size, frequency), (largest, frequencies) = (
            follow(error, settled),
            expected_ripple(error, settled),
        )
        assert size == pytest.approx(largest, rel=1e-12)
        assert any(frequency == pytest.approx(candidate, rel=1e-12) for candidate in frequencies)


TIME = np.arange(0.0, 60.0, TICK)
ALWAYS = np.ones(TIME.size, dtype=bool)


@pytest.mark.parametrize("mean", [0.0, 5.0, -10.0])
def test_a_cycle_has_its_size_from_side_to_side_and_its_frequency(mean):
    wave = mean + 5.0 * np.sin(0.8 * TIME)
    assert follow(wave, ALWAYS) == pytest.approx((10.0, 0.8 / (2.0 * np.pi)), rel=5e-3)
    noisy = wave + np.random.default_rng(1).uniform(-0.1, 0.1, TIME.size)
    assert follow(noisy, ALWAYS) == pytest.approx((10.2, 0.8 / (2.0 * np.pi)), rel=0.05)


@pytest.mark.parametrize("name", ["tlc", "lqr"])
def test_the_metrics_are_those_of_the_recorded_flight(name):
    plan = make_flight_plan("s_manoeuvre", "ghame_x", controller=name)
    parameters = nominal_parameters(3)
    parameters[:, PARAMETER_INDEX["atmosphere.density"]] = 1.0, 0.92, 1.07
    parameters[:, PARAMETER_INDEX["initial.sideslip"]] = 0.0, 0.01, -0.01
    block = fly(plan, parameters, record_every=1)
    settled = plan.reference[: plan.timing.ticks + 1, ref.SETTLED] > 0.0
    for row, metrics in zip(block.history.astype(np.float64), block.metrics, strict=True):
        for angle in ("bank", "angle_of_attack"):
            error = (
                row[:, CHANNEL_INDEX[f"{angle}_deg"]]
                - row[:, CHANNEL_INDEX[f"{angle}_command_deg"]]
            )
            expected_size, frequencies = expected_ripple(error, settled)  # histories are float32
            assert metrics[METRIC_INDEX[f"{angle}_ripple_deg"]] == pytest.approx(
                expected_size, abs=2e-5, rel=1e-5
            )
            frequency = metrics[METRIC_INDEX[f"{angle}_cycle_hz"]]
            assert any(frequency == pytest.approx(candidate, rel=0.05) for candidate in frequencies)
    if name == "lqr":  # it cycles in angle of attack, which nobody sees in its rms
        assert block.metrics[0, METRIC_INDEX["angle_of_attack_ripple_deg"]] > 5.0
