"""Flights of a user's simulator that are run again and compared."""

from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.bounds import Bounds
from abhv_mc.execution.first_flights import _judge_repeats, _Repeats
from abhv_mc.execution.retention import StoredFlights, find_difference
from abhv_mc.flights.outcomes import OUTCOMES, Outcome
from abhv_mc.flights.repeatability import Repeatability

CAMPAIGN = SimpleNamespace(
    measured=[SimpleNamespace(name="height"), SimpleNamespace(name="range")],
    inputs=("a",),
    outcomes=OUTCOMES,
    runs=1000,
    simulator=SimpleNamespace(states_noise=False),
)


def test_the_largest_difference_is_relative_and_that_of_outcomes_is_infinite():
    flight = np.array([0.0, 1.0, 2.0])
    pairs = [
        (np.array([7.0]), flight, np.array([0.0, 1.001, 2.0])),
        (np.array([8.0]), flight, np.array([0.0, 1.0, 2.5])),
        (np.array([9.0]), flight, np.array([0.0, 1.1, 2.0])),
    ]
    found = find_difference(CAMPAIGN, "s", pairs)
    assert found.size == pytest.approx(0.2) and "range 2 and 2.5" in found.description
    assert "a 8" in found.description
    other = np.array([float(Outcome.BANK_LIMIT), 1.0, 2.0])
    found = find_difference(CAMPAIGN, "s", [*pairs, (np.array([6.0]), flight, other)])
    assert np.isinf(found.size) and "ok and bank_limit" in found.description
    assert find_difference(CAMPAIGN, "s", [(np.array([7.0]), flight, flight)]) == (0.0, "")


@pytest.mark.parametrize(("shard", "count"), [((0, 60), 4), ((500, 600), 5), ((0, 1000), 20)])
def test_failures_are_run_again_first_and_then_the_worst(shard, count):
    """Flights 999 and 40 are the worst in one metric each; 998 failed to run."""
    number = np.arange(1000)
    values = np.column_stack([number, np.where(number == 40, 2000, 0), number])
    codes = np.where(number == 998, "failed_to_run", "ok").tolist()
    stored = StoredFlights(CAMPAIGN, shard)
    rows = SimpleNamespace(controller="s", outcome=codes, values=values, flights=number)
    stored.add(rows)
    missed = np.isin(number, (7, 550))
    asked = [SimpleNamespace(metric=own.name, limits=Bounds(high=1e4)) for own in CAMPAIGN.measured]
    counts = [SimpleNamespace(requirement=item, missed=missed) for item in asked]
    chosen = stored.choose(SimpleNamespace(controller="s", requirements=counts)).tolist()
    assert len(chosen) == count and {*chosen[:2]} == {7, 550}
    assert {*chosen[2:4]} == {999, 40} and {*chosen[4:5]} <= {0, 997}


def repeats(text):
    """Return flights of rows 1, 2, ..., and, after a bar, of repeated rows in reverse order."""
    first, again = (list(map(float, part.split())) for part in text.split("|"))
    rows = np.arange(1.0, 1.0 + len(first))[:, None]
    repeated = rows[: len(again)] if len(again) < len(first) else rows[::-1]
    values = np.pad(np.array([[*first, *again]]).T, ((0, 0), (1, 1)))
    return _Repeats(np.concatenate([rows, repeated]), values, (), len(first))


@pytest.mark.parametrize(
    ("a", "b", "declared", "expected"),
    [
        ("1 2 | 2 1", "1 2 | 2 1", False, Repeatability.EXACT),
        ("1 2 | 2 1", "1 2.000000000001 | 2 1", False, Repeatability.ROUNDING),
        ("1 2 | 2 1", "1 2.1 | 2.1 1", False, Repeatability.NOISE),
        ("1 2 | 2 1.1", "1 2 | 2 1.1", False, Repeatability.NOISE),
        ("1 2 | 2 1.1", "1 2 | 2 1.1", True, Repeatability.SHARED),
        ("1 2 | 2 1.1", "1.3 2 | 2 1.1", True, Repeatability.DECLARED),
        ("1 2 | 2 1", "1 2 | 1", False, Repeatability.EXACT),
    ],
)
def test_noise_is_found_between_and_within_processes(monkeypatch, a, b, declared, expected):
    monkeypatch.setattr(CAMPAIGN.simulator, "states_noise", declared)
    state, warnings = _judge_repeats(CAMPAIGN, {"s": [repeats(a), repeats(b)]})
    assert state == expected and len(warnings) == (not state.is_evidence)
