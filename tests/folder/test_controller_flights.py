"""Ranking of flights and signs of metrics, against values computed by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.bounds import Bounds
from abhv_mc.flights.outcomes import OUTCOMES, Outcome
from abhv_mc.folder.controller_flights import (
    ControllerFlights,
    _Collector,
    common_rows,
    distances,
    metric_sign,
    pooled_values,
    rank_flights,
    severities,
)
from abhv_mc.statistics.estimates import Criterion

METRICS = ("miss", "range", "alpha")
RECORDS = dict(zip(METRICS, (
    SimpleNamespace(bad="high", band=None),
    SimpleNamespace(bad="low", band=None),
    SimpleNamespace(bad="low", band=Bounds(low=2.0, high=4.0)),
), strict=True))  # fmt: skip


def make_flights(end_time, **metrics):
    """Flights that ended early at finite times."""
    lost = np.isfinite(end_time)
    return ControllerFlights(
        flight=np.arange(lost.size),
        outcome=np.where(lost, 3, Outcome.OK).astype(np.uint8),
        metrics={"end_time_s": np.array(end_time)} | {k: np.array(v) for k, v in metrics.items()},
        absent=np.empty(0, np.int64),
        records=RECORDS,
    )


@pytest.mark.parametrize(
    ("metric", "sign", "expected"),
    [("miss", 1.0, [1.0, 3.0, np.inf]),
     ("range", -1.0, [-1.0, -3.0, np.inf]),
     ("alpha", 1.0, [1.0, -1.0, np.inf])],  # beyond the nearer limit
)  # fmt: skip
def test_distances_and_their_sign(metric, sign, expected):
    flights = make_flights([np.inf, np.inf, 5.0], **{metric: [1.0, 3.0, 3.0]})
    np.testing.assert_array_equal(distances(flights, metric), expected)
    assert metric_sign(RECORDS[metric]) == sign


def test_the_worst_flights_are_the_earliest_losses_then_the_largest_relative_exceedances():
    """The limit of 10 is its unit; the median of the ranges, 200, is origin and unit."""
    flights = {
        "b": make_flights([np.inf, 20.0, np.inf], miss=[12.0, 0.0, 1.0], range=[200.0, 9.0, 50.0]),
        "a": make_flights([7.0, np.inf], miss=[0.0, 11.0], range=[0.0, 300.0]),
    }
    criteria = [Criterion("miss", "high", Bounds(high=10.0)), Criterion("range", "low")]
    ranking = rank_flights(flights, criteria)
    np.testing.assert_allclose(ranking.beyond["a"], [np.inf, 0.1])
    np.testing.assert_allclose(ranking.beyond["b"], [0.2, np.inf, 0.75])  # (200 - 50) / 200
    assert ranking.criterion_index["b"].tolist()[::2] == [0, 1]
    names = [ranking.controllers[k] for k in ranking.controller]
    worst = [*zip(names, ranking.row.tolist(), strict=True)]
    assert worst == [("a", 0), ("b", 1), ("b", 2), ("b", 0), ("a", 1)]
    assert ranking.rows_of("b").tolist() == [1, 2, 0] and ranking.ranks_of("b").tolist() == [
        3,
        1,
        2,
    ]


@pytest.mark.parametrize(
    "parts", [((0, 1, 2), (3, 4)), ((3, 4), (1, 2), (0,)), ((2, 4), (0, 1, 3))]
)
def test_flights_are_in_ascending_order_without_those_that_failed_to_run(parts):
    """Of flight k, the outcome is 3 if k is odd; flight 4 failed to run."""
    collector = _Collector(["a", "b"])
    for part in parts:
        number = np.array(part)
        outcome = np.where(number % 2, 3, np.where(number == 4, Outcome.FAILED_TO_RUN, 0))
        collector.add(number, outcome.astype(np.uint8), np.stack([number + 0.5, number * 10.0]))
    flights = collector.finish(RECORDS, None)
    assert flights.flight.tolist() == [0, 1, 2, 3] and flights.absent.tolist() == [4]
    assert flights.outcome.tolist() == [0, 3, 0, 3]
    assert flights.metrics["a"].tolist() == [0.5, 1.5, 2.5, 3.5]
    assert flights.metrics["b"].tolist() == [0.0, 10.0, 20.0, 30.0]


def test_flights_of_two_controllers_are_paired_counted_and_pooled():
    first = make_flights([np.inf, 4.0, np.inf, np.inf], miss=[1.0, 2.0, 3.0, 4.0])
    second = make_flights([np.inf, np.inf, 2.0], miss=[9.0, 0.5, 7.0])
    second = replace(second, flight=np.array([3, 4, 1]), ends=OUTCOMES)
    a, b = common_rows(first, second)
    assert (a.tolist(), b.tolist()) == ([1, 3], [2, 0])
    assert pooled_values({"a": first, "b": second}, "miss").tolist() == [0.5, 1.0, 3.0, 4.0, 9.0]
    assert severities(first, "miss").tolist() == [1.0, np.inf, 3.0, 4.0]
    assert severities(first, "miss", np.array([2, 1])).tolist() == [3.0, np.inf]
    numbers = {number: code for code, number in OUTCOMES.numbers.items()}
    assert second.count_outcomes() == {"ok": 2, numbers[3]: 1}
