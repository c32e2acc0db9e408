"""Ripples against numpy: of the definition on made-up signals, and of recorded flights."""

import itertools
from itertools import pairwise

import numpy as np
import pytest

from abhv_mc import flying
from abhv_mc.control import columns as ref
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.ripple import FREQUENCY, N_RIPPLE_ROWS, QUICK, SLOW, WIGGLE, begin_swings, end_swing, watch_swings
from abhv_mc.flying import make_flight_plan
from abhv_mc.plant.parameters import PARAMETER_INDEX


def turning_points(stretch, wiggle, remembered) -> list[int]:
    """Where it turns back by more than ``wiggle`` of the swing, or ``remembered`` of the one before; it begins at 0."""
    moving = np.flatnonzero(np.diff(stretch))
    if not moving.size:
        return []
    way = np.sign(stretch[moving[0] + 1] - stretch[moving[0]])
    turns, last, seen, before = [], stretch[0], 0, 0.0
    while True:
        rising = way * stretch[seen:]
        top = np.maximum.accumulate(rising)
        back = top - rising
        enough = np.flatnonzero((back >= WIGGLE) & (back >= wiggle * np.maximum(top - way * last, remembered * before)))
        if not enough.size:
            return turns
        turns.append(seen + int(np.argmax(rising[: enough[0]])))
        before, last, seen, way = abs(stretch[turns[-1]] - last), stretch[turns[-1]], seen + int(enough[0]), -way


def expected_ripple(error, settled) -> tuple[float, list[float]]:
    """Size of the largest cycle of three swings, by definition, and the frequency of each cycle of that size."""
    starts = np.flatnonzero(settled & ~np.concatenate([[False], settled[:-1]]))
    stops = np.flatnonzero(settled & ~np.concatenate([settled[1:], [False]])) + 1
    found = [(0.0, 0.0)]
    stretches = [error[start:stop] for start, stop in zip(starts, stops, strict=True)]
    for stretch, kind in itertools.product(stretches, ((SLOW, 1.0), (QUICK, 0.0))):
        turns = turning_points(stretch, *kind)
        swings, lengths = np.abs(np.diff(stretch[turns])), np.diff(turns)
        for i in range(len(swings) - 2):
            three, long = swings[i : i + 3], lengths[i : i + 3]
            if (three[1:] >= 0.5 * three[:-1]).all() and long.max() <= 2 * long.min():
                found.append((float(three.max()), 150.0 / float(long.sum())))
    largest = max(found)[0]
    return largest, [frequency for size, frequency in found if size >= (1.0 - 1e-12) * largest]


def follow(error, settled) -> tuple[float, float]:
    Z, largest = np.zeros((N_RIPPLE_ROWS + 2, 1)), 0.0
    given, ends = N_RIPPLE_ROWS, N_RIPPLE_ROWS + 1
    begin_swings(Z, 1, 0)
    for tick, (value, calm) in enumerate(zip(error.tolist(), settled.tolist(), strict=True)):
        Z[given, 0] = value
        if not calm:
            begin_swings(Z, 1, 0)
            continue
        watch_swings(Z, 1, 0, given, 1.0, float(tick), ends)
        if Z[ends, 0] > 0.0:
            largest = max(largest, end_swing(Z, 0, 0, value, float(tick), 0.01))
    return largest, float(Z[FREQUENCY, 0])


def zigzag(generator) -> np.ndarray:
    """Straight lines between turning points, each swing a tenth to ten times the one before."""
    swings = [generator.uniform(0.5, 2.0)]
    for factor in 10.0 ** generator.uniform(-1.0, 1.0, 14):
        swings.append(np.clip(factor * swings[-1], max(0.01, 0.1 * swings[-1]), min(100.0, 10.0 * swings[-1])))
    points = np.cumsum([generator.normal(), *swings * (-1.0) ** np.arange(len(swings))])
    return np.concatenate([np.linspace(a, b, 9)[:-1] for a, b in pairwise(points)])


@pytest.mark.parametrize("seed", range(40))
def test_it_is_the_definition_on_any_signal(seed: int) -> None:
    generator = np.random.default_rng(seed)
    signals = (
        zigzag(generator),
        np.cumsum(generator.normal(size=600)),
        np.round(generator.normal(size=600), 1),
        np.sin(np.cumsum(generator.uniform(0.02, 0.06, 600))) * np.exp(generator.normal() * np.linspace(0.0, 2.0, 600)),
    )
    for error in signals:
        settled = np.repeat(generator.uniform(size=error.size // 8 + 1) < 0.95, 8)[: error.size]
        (size, frequency), (largest, frequencies) = follow(error, settled), expected_ripple(error, settled)
        assert size == pytest.approx(largest, rel=1e-12)
        assert any(frequency == pytest.approx(each, rel=1e-12) for each in frequencies)


def test_a_cycle_has_its_size_from_side_to_side_and_its_frequency() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    settled = np.ones(time.size, dtype=bool)
    assert follow(1.5 * np.sin(4.0 * time), settled) == pytest.approx((3.0, 2.0 / np.pi), rel=5e-3)
    noise = np.random.default_rng(1).uniform(-0.1, 0.1, time.size)
    assert follow(5.0 * np.sin(4.0 * time) + noise, settled)[0] == pytest.approx(10.0, abs=0.4)
    assert follow(5.0 * np.exp(-time) + noise, settled)[0] <= 0.4
    assert follow(np.exp(-time), settled) == (0.0, 0.0)
    assert follow(np.exp(-3.0 * time) * np.sin(6.0 * time), settled)[0] < 0.2  # each swing a fifth of the one before
    drift = np.interp(np.arange(200.0), [0.0, 22.0, 119.0, 164.0, 188.0], [0.0, 9.0, 0.0, 8.0, 1.0])
    assert follow(drift, np.ones(200, dtype=bool))[0] == 0.0  # turning points at 22, 119, 164, 188 s


# A bank that goes 63 and 68 deg from side to side every 70 s has no three swings in 60 s: its chatter is found there.
LONG = {"base": "level", "duration": "200 s"}
CYCLING = {
    "rudder": ("level", "tlc", {"control.rudder_effectiveness": 1.12}, "bank", 15.9, 0.10),
    "aileron": ("level", "tlc", {"control.aileron_effectiveness": 0.84}, "bank", 24.3, 0.08),
    "chatter": ("level", "tlc", {"control.rudder_effectiveness": 1.3}, "bank", 6.50, 2.055),
    "chatter_aileron": ("level", "tlc", {"control.aileron_effectiveness": 0.7}, "bank", 4.30, 1.724),
    "slow": (LONG, "tlc", {"control.rudder_effectiveness": 1.3}, "bank", 28.4, 0.014),
    "slow_aileron": (LONG, "tlc", {"control.aileron_effectiveness": 0.7}, "bank", 54.25, 0.014),
    "paper": ("level", "lqr", {}, "angle_of_attack", 12.8, 0.4),
    "turn": ("turn", "tlc", {}, "bank", 0.0, 0.0),
    "turn_lqr": ("turn", "lqr_robust", {}, "bank", 0.0, 0.0),
    "s": ("s_manoeuvre", "lqr_robust", {}, "bank", 0.0, 0.0),
    "climb": ("climb", "tlc", {}, "bank", 0.0, 0.0),
}
EACH_KIND = ("rudder", "chatter_aileron", "slow", "paper", "turn", "s")


@pytest.mark.parametrize(
    "case", [case if case in EACH_KIND else pytest.param(case, marks=pytest.mark.thorough) for case in CYCLING]
)
def test_flights_that_cycle_and_flights_that_do_not(case: str) -> None:
    mission, controller, dispersions, angle, size, frequency = CYCLING[case]
    metrics = flying.fly(mission, "ghame_x", controller, dispersions, every=100).attrs["metrics"]
    assert metrics[f"{angle}_ripple_deg"] == pytest.approx(size, abs=0.15)
    assert metrics[f"{angle}_cycle_hz"] == pytest.approx(frequency, rel=0.1, abs=5e-3)


@pytest.mark.parametrize("name", ["tlc", "lqr"])
def test_the_metrics_are_those_of_the_recorded_flight(name: str) -> None:
    plan = make_flight_plan("s_manoeuvre", controller=name)
    parameters = nominal_parameters(3)
    parameters[:, PARAMETER_INDEX["atmosphere.density"]] = 1.0, 0.92, 1.07
    parameters[:, PARAMETER_INDEX["initial.sideslip"]] = 0.0, 0.01, -0.01
    block = fly(plan, parameters, record_every=1)
    settled = plan.reference[: plan.timing.ticks + 1, ref.SETTLED] > 0.0
    for row, metrics in zip(block.history.astype(np.float64), block.metrics, strict=True):
        for angle in ("bank", "angle_of_attack"):
            error = row[:, CHANNEL_INDEX[f"{angle}_deg"]] - row[:, CHANNEL_INDEX[f"{angle}_command_deg"]]
            wanted, _ = expected_ripple(error, settled)  # histories are float32
            assert metrics[METRIC_INDEX[f"{angle}_ripple_deg"]] == pytest.approx(wanted, abs=2e-5, rel=1e-5)
    if name == "lqr":  # it cycles in angle of attack, which nobody sees in its rms
        assert block.metrics[0, METRIC_INDEX["angle_of_attack_ripple_deg"]] > 5.0
