"""Flights of a user's simulator that are run again and compared."""

from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.bounds import Bounds
from abhv_mc.execution import retention
from abhv_mc.execution.retention import StoredFlights, find_difference, select_flights
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.outcomes import OUTCOMES, Outcome

CAMPAIGN = SimpleNamespace(
    measured=[SimpleNamespace(name="height"), SimpleNamespace(name="range")],
    inputs=("a",),
    outcomes=OUTCOMES,
    runs=1000,
)


def test_the_largest_difference_is_relative_and_that_of_outcomes_is_infinite():
    flight, bank = np.array([0.0, 1.0, 2.0]), float(Outcome.BANK_LIMIT)
    others = {7.0: [0.0, 1.001, 2.0], 8.0: [0.0, 1.0, 2.5], 9.0: [0.0, 1.1, 2.0]}
    for row, size, words in ((8, 0.2, "range 2 and 2.5"), (6, np.inf, "ok and bank_limit")):
        pairs = [(np.array([a]), flight, np.array(other)) for a, other in others.items()]
        found = find_difference(CAMPAIGN, "s", pairs)
        assert found.size == pytest.approx(size) and words in found.description
        assert f"a {row}" in found.description
        others[6.0] = [bank, 1.0, 2.0]


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
    assert {*chosen[2:4]} == {999, 40}


def test_flights_to_store_are_selected_by_number_step_outcome_and_rank():
    counts = SimpleNamespace(failed=[3, 8], not_computed=[5, 8])
    worst = [9, 1, 5, 0]
    for items, expected in [
        (("all",), [0, 1, 2, 3, 4, 6, 7, 9]),
        (("failed", 2, "2"), [2, 3]),
        (("every 3",), [0, 3, 6, 9]),
        (("worst 3",), [1, 9]),
        ((9, 10, 5), [9]),
        ((), []),
    ]:
        assert select_flights(items, 10, counts, worst) == expected


@pytest.mark.parametrize(
    ("changed", "size", "words"),
    [
        ({}, 0.0, ""),
        ({("s", 2): [7.0, 2.5], ("t", 3): [7.0, 3.0 + 3e-12]}, 0.2, "'s' returns range 2 and 2.5"),
        ({("t", 1): [7.0, 1.0, Outcome.BANK_LIMIT]}, np.inf, "'t' returns outcome ok and bank"),
        ({("s", 2): [0.0, 0.0, Outcome.FAILED_TO_RUN]}, 0.0, ""),  # lost now, but not before
    ],
)
def test_stored_flights_are_flown_again_in_new_processes(monkeypatch, changed, size, words):
    """The largest difference is that of all systems."""
    closed, flown = [], []
    engine = SimpleNamespace(close=lambda: closed.append("closed"))
    campaign = SimpleNamespace(**vars(CAMPAIGN) | {"simulator": SimpleNamespace(engine=engine)})

    def simulate(campaign, name, rows, recording, fly):
        assert closed == ["closed"] and campaign == "proven" and recording is None
        number = int(rows[0, 0])
        flown.append((name, number))
        *metrics, outcome = [*changed.get((name, number), [7.0, float(number)]), 0][:3]
        return FlightBlock(np.array([outcome]), np.ones(1), np.array([metrics]))

    def prove(campaign, check):
        assert check == -1
        return SimpleNamespace(**vars(campaign))

    monkeypatch.setattr(retention, "with_proofs", prove)
    monkeypatch.setattr(retention, "simulate", lambda campaign, *rest: simulate("proven", *rest))
    stored = StoredFlights(campaign, (0, 5))
    for name in "st":
        number = np.arange(5)
        values = np.column_stack([np.full(5, 7.0), number, number])
        codes = ["ok"] * 4 + ["failed_to_run"]
        stored.add(SimpleNamespace(controller=name, outcome=codes, values=values, flights=number))
    counts = {name: SimpleNamespace(controller=name, requirements=[]) for name in "st"}
    samples = SimpleNamespace(rows=lambda first, stop: np.arange(first, stop)[:, None] * 1.0)
    found = stored.run_again(None, 2, samples, counts)
    assert sorted(flown) == [(name, number) for name in "st" for number in range(4)]
    assert found.size == pytest.approx(size) and found.description.startswith(words)
