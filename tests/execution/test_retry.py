"""Blocks of flights, and the sizes of the pieces in which lost flights are computed again."""

from dataclasses import replace

import numpy as np
import pytest
from fake_flight import DENSITY, fly, make_plan

from abhv_mc.execution.retry import (
    PIECE,
    FlightLostError,
    UnusableError,
    choose_batch,
    choose_timed,
    choose_unrecorded,
    cut_blocks,
    fly_with_retries,
    time_limit,
)
from abhv_mc.execution.worker import usual_limit
from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.flight.fly import nominal_parameters


def test_blocks_give_each_worker_two_or_more():
    assert [choose_batch(flights, 4) for flights in (64, 512, 520, 100_000)] == [32, 64, 96, 256]
    assert [choose_unrecorded(n, 4, 256) for n in (100, 100_000, 10**6)] == [256, 24 * 256, 8192]
    assert [choose_timed(1000, 4, seconds) for seconds in (0.0, 0.5, 60.0)] == [63, 20, 1]


def test_time_limits_apply_to_pieces_of_16_flights():
    assert [time_limit(flights, 3.0) for flights in (1, 16, 17, 33)] == [3.0, 3.0, 6.0, 9.0]


@pytest.mark.parametrize(
    ("process", "hung", "outcome"),
    [
        (False, True, Outcome.FAILED_TO_RUN),
        (True, False, Outcome.LAW_CRASHED),
        (True, True, Outcome.LAW_HUNG),
    ],
)
def test_a_lost_flight_is_tried_twice_alone_and_the_others_are_computed(process, hung, outcome):
    """Flight 259 is in the second of two batches of at most 256 flights, of 256 and 44."""
    plan, sizes = replace(make_plan("one"), law="c"), []
    rows = nominal_parameters(300)
    rows[:, DENSITY] += np.arange(300) * 1e-4
    lost = rows[259, DENSITY]

    def attempt(parameters, recorded):
        sizes.append(len(parameters))
        if lost in parameters[:, DENSITY]:
            raise FlightLostError(f"lost {process} {hung}", process, hung)
        return fly(plan, parameters, recorded)

    block = fly_with_retries(attempt, plan, rows, None)
    assert sizes == [300, 256, 44, 16, *[1] * 17, 16, 12]
    assert np.flatnonzero(block.outcome).tolist() == [259] and block.outcome[259] == outcome
    assert [*block.reasons] == [259]
    others = np.arange(300) != 259
    assert np.array_equal(block.metrics[others], fly(plan, rows[others]).metrics)


@pytest.mark.parametrize("flights", [PIECE - 1, PIECE])
def test_no_computed_flight_of_16_stops_a_campaign(flights):
    def attempt(parameters, recorded):
        raise FlightLostError("never")

    plan, rows = make_plan("one"), nominal_parameters(flights)
    if flights == 16:
        with pytest.raises(UnusableError, match=r"16 flights .*\(never\)"):
            fly_with_retries(attempt, plan, rows, None)
    else:
        block = fly_with_retries(attempt, plan, rows, None)
        assert (block.outcome == Outcome.FAILED_TO_RUN).all() and len(block.outcome) == 15


def test_blocks_end_where_missing_data_changes_and_alternate_between_controllers():
    flight = np.arange(14)
    missing = {"a": (flight >= 0, flight < 0), "b": (flight > 5, flight < 8)}
    blocks = list(cut_blocks(missing, 4, cut=3, unrecorded=(8, 5)))
    text = {"a": "0-3r 3-4r 4-8r 8-13r 13-14r", "b": "0-3e 3-4e 4-6e 6-8re 8-13r 13-14r"}
    for name, expected in text.items():
        own = [block for block in blocks if block.controller == name]
        data = ["r" * block.needs_rows + "e" * block.needs_envelope for block in own]
        ends = [f"{block.first}-{block.first + block.flights}" for block in own]
        assert " ".join(map("".join, zip(ends, data, strict=True))) == expected
    assert "".join(block.controller for block in blocks) == "abababababb"


def test_a_loss_is_reported_once(capsys, monkeypatch):
    monkeypatch.setattr("abhv_mc.execution.retry._reported", set())
    plan, rows = make_plan("one"), nominal_parameters(40)

    def lose(message, flights):
        def attempt(parameters, recorded):
            if len(parameters) > flights:
                raise FlightLostError(message)
            return fly(plan, parameters, recorded)

        fly_with_retries(attempt, plan, rows, None)
        return capsys.readouterr().err.count(f"({message})")

    lost = [lose(*case) for case in (("too long", 16), ("too long", 16), ("too large", 1))]
    assert lost == [1, 0, 1]


@pytest.mark.parametrize(
    ("seconds", "limit", "flights"),
    [([0.05], 30.0, 1), ([9.0, 0.05], 30.0, 2), ([9.0, 0.2], 64.0, 2)],
)
def test_the_limit_is_20_times_16_flights_and_ignores_compilation(seconds, limit, flights):
    plan, flown, elapsed, left = make_plan("one"), [], 100.0, iter(seconds)

    def fly_slowly(plan, parameters, recorded):
        nonlocal elapsed
        flown.append(len(parameters))
        elapsed += next(left)

    assert usual_limit(fly_slowly, plan, lambda: elapsed) == pytest.approx(limit)
    assert len(flown) == flights
