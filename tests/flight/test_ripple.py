"""Ripples against numpy: of the definition on made-up signals, and of recorded flights."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from abhv_mc.control import columns as ref
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.prepare import prepare
from abhv_mc.flight.ripple import N_RIPPLE_ROWS, WIGGLE, follow_ripple
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.shipped import shipped_configs


def turning_points(stretch, wiggle) -> list[int]:
    """Where it turns back by more than ``wiggle`` of the swing or of the one before; the first swing begins at 0."""
    moving = np.flatnonzero(np.diff(stretch))
    if not moving.size:
        return []
    way = np.sign(stretch[moving[0] + 1] - stretch[moving[0]])
    turns, last, seen, before = [], stretch[0], 0, 0.0
    while True:
        rising = way * stretch[seen:]
        top = np.maximum.accumulate(rising)
        back = top - rising
        enough = np.flatnonzero((back > 0.0) & (back >= wiggle * np.maximum(top - way * last, before)))
        if not enough.size:
            return turns
        turns.append(seen + int(np.argmax(rising[: enough[0]])))
        before, last, seen, way = abs(stretch[turns[-1]] - last), stretch[turns[-1]], seen + int(enough[0]), -way


def expected_ripple(error, settled, wiggle=0.0) -> float:
    """Largest swing between turning points with an opposite one of at least half its size after it, by definition."""
    starts = np.flatnonzero(settled & ~np.concatenate([[False], settled[:-1]]))
    stops = np.flatnonzero(settled & ~np.concatenate([settled[1:], [False]])) + 1
    found = 0.0
    for stretch in (error[start:stop] for start, stop in zip(starts, stops, strict=True)):
        turns = turning_points(stretch, wiggle)
        points = stretch[turns]
        for i in range(1, len(points)):
            after = stretch[turns[i] : turns[i + 1] + 1 if i + 1 < len(points) else None]
            if np.abs(after - points[i]).max() >= 0.5 * abs(points[i] - points[i - 1]):
                found = max(found, abs(points[i] - points[i - 1]))
    return float(found)


def follow(error, settled) -> float:
    Z, largest = np.zeros((N_RIPPLE_ROWS, 1)), 0.0
    for value, calm in zip(error.tolist(), settled.tolist(), strict=True):
        largest = max(largest, follow_ripple(Z, 0, 0, value, calm))
    return largest


def zigzag(generator) -> np.ndarray:
    """Straight lines between turning points, each swing a tenth to ten times the one before."""
    swings = [generator.uniform(0.5, 2.0)]
    for factor in 10.0 ** generator.uniform(-1.0, 1.0, 14):
        swings.append(np.clip(factor * swings[-1], max(0.01, 0.1 * swings[-1]), min(100.0, 10.0 * swings[-1])))
    points = np.cumsum([generator.normal(), *swings * (-1.0) ** np.arange(len(swings))])
    return np.concatenate([np.linspace(a, b, 9)[:-1] for a, b in pairwise(points)])


@pytest.mark.parametrize("seed", range(40))
def test_it_is_the_definition_on_any_signal_without_wiggles(seed: int) -> None:
    generator = np.random.default_rng(seed)
    error = zigzag(generator)
    settled = np.repeat(generator.uniform(size=error.size // 8) < 0.8, 8)
    assert follow(error, settled) == pytest.approx(expected_ripple(error, settled), rel=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_it_is_the_definition_on_any_signal(seed: int) -> None:
    generator = np.random.default_rng(seed)
    error = np.cumsum(generator.normal(size=600)) if seed % 2 else np.round(generator.normal(size=600), 1)
    settled = np.repeat(generator.uniform(size=12) < 0.8, 50)
    assert follow(error, settled) == pytest.approx(expected_ripple(error, settled, WIGGLE), rel=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_wiggles_hide_no_cycle_and_make_none(seed: int) -> None:
    time = np.arange(0.0, 10.0, 0.01)
    settled = np.ones(time.size, dtype=bool)
    noise = np.random.default_rng(seed).uniform(-0.1, 0.1, time.size)
    assert follow(5.0 * np.sin(4.0 * time) + noise, settled) == pytest.approx(10.0, abs=0.4)
    assert follow(5.0 * np.exp(-time) + noise, settled) <= 0.4
    after = 40.0 * np.exp(-5.0 * time) + np.sin(4.0 * time)  # a cycle after a large decay
    assert follow(after, settled) == pytest.approx(2.0, abs=0.1)


def test_a_cycle_is_a_ripple_of_its_peak_to_peak_and_a_slow_decay_is_none() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    settled = np.ones(time.size, dtype=bool)
    assert follow(1.5 * np.sin(4.0 * time), settled) == pytest.approx(3.0, abs=1e-3)
    assert follow(np.exp(-time), settled) == 0.0
    assert follow(np.exp(-3.0 * time) * np.sin(6.0 * time), settled) < 0.2  # each swing a fifth of the one before


@pytest.mark.parametrize("name", ["tlc", "lqr"])
def test_the_metrics_are_those_of_the_recorded_flight(name: str) -> None:
    configs = Path(shipped_configs())
    plan = prepare(
        configs / "vehicle/ghame_x.yaml", configs / "mission/s_manoeuvre.yaml", configs / f"control/{name}.yaml", name
    )
    parameters = nominal_parameters(3)
    parameters[:, PARAMETER_INDEX["atmosphere.density"]] = 1.0, 0.92, 1.07
    parameters[:, PARAMETER_INDEX["initial.sideslip"]] = 0.0, 0.01, -0.01
    block = fly(plan, parameters, record_every=1)
    settled = plan.reference[: plan.timing.ticks + 1, ref.SETTLED] > 0.0
    for row, metrics in zip(block.history.astype(np.float64), block.metrics, strict=True):
        for angle in ("bank", "angle_of_attack"):
            error = row[:, CHANNEL_INDEX[f"{angle}_deg"]] - row[:, CHANNEL_INDEX[f"{angle}_command_deg"]]
            wanted = expected_ripple(error, settled, WIGGLE)  # histories are float32
            assert metrics[METRIC_INDEX[f"{angle}_ripple_deg"]] == pytest.approx(wanted, abs=2e-5, rel=1e-5)
        wanted = expected_ripple(row[:, CHANNEL_INDEX["sideslip_deg"]], settled, WIGGLE)
        assert metrics[METRIC_INDEX["sideslip_ripple_deg"]] == pytest.approx(wanted, abs=2e-5, rel=1e-5)
    if name == "lqr":  # it cycles in angle of attack, which nobody sees in its rms
        assert block.metrics[0, METRIC_INDEX["angle_of_attack_ripple_deg"]] > 5.0
