"""Tolerance limits of verdicts and the cells that show them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from report.synthetic import write_campaign

from abhv_mc.bounds import Bounds
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import _unlimited, find_tolerance

NONE = np.empty(0, int)
# numbers of flights with which 0, 1 and 2 failures pass
FIRST, SECOND, THIRD = (flights_to_pass(failures, 0.9, 0.1) for failures in range(3))


def tolerance(values, bounds, failed=(), points=1, judged=(0,), absent=NONE, early=True):
    """Return the limit for 90 % of the flights at a consumer's risk of 10 %."""
    values = np.asarray(values, float)
    flights = SimpleNamespace(
        metrics={"x": values},
        failed=np.isin(np.arange(values.size), failed),
        flight=np.arange(values.size),
        absent=np.asarray(absent),
    )
    requirement = SimpleNamespace(
        metric="x", limits=bounds, early_is_failure=early, probability=0.9, consumer_risk=0.1
    )
    return find_tolerance(flights, requirement, points, judged)


@pytest.mark.parametrize(
    ("flights", "rank"), [(FIRST, 1), (SECOND - 1, 1), (SECOND, 2), (THIRD - 1, 2), (THIRD, 3)]
)
def test_the_limit_is_the_largest_value_that_may_not_fail(flights, rank):
    values = np.random.default_rng(1).permutation(np.arange(1.0, flights + 1))
    limit = flights + 1.0 - rank
    share = pytest.approx((200 - limit) / 200)
    assert tolerance(values, Bounds(high=200)) == (limit, share, False)
    assert tolerance(-values, Bounds(low=-200)) == (-limit, share, False)


def test_two_limits_give_a_distance_and_a_share_of_half_the_width():
    values = np.linspace(-2.0, 3.0, FIRST)
    assert tolerance(values, Bounds(-4.0, 4.0)) == (-1.0, pytest.approx(0.25), False)
    assert tolerance(values, Bounds(-1.0, 5.0)) == (1.0, pytest.approx(-1.0 / 3.0), False)
    assert tolerance(values, Bounds(high=0.0))[:2] == (3.0, None)  # a share of zero


def test_too_few_flights_and_too_many_early_terminations_are_distinguished():
    values = np.ones(FIRST)
    assert tolerance(values[:-1], Bounds(high=2)) == (None, None, False)
    assert tolerance(values, Bounds(high=2), failed=[3]) == (None, None, True)
    assert tolerance(values, Bounds(high=2), failed=[3], early=False) == (1.0, 0.5, False)
    assert tolerance(values[:-1], Bounds(high=2), absent=[FIRST - 1]) == (None, None, True)
    values[5] = np.nan
    assert tolerance(values, Bounds(high=2), early=False) == (None, None, True)


def test_the_worst_of_the_judged_points_counts():
    values = np.arange(3.0 * FIRST) % 3 + 1.0  # at three points
    for judged, limit in (((0,), 1.0), ((0, 1), 2.0), ((0, 2), 3.0)):
        found = tolerance(values, Bounds(high=4), points=3, judged=judged)
        assert found == (limit, pytest.approx((4 - limit) / 4), False)
    lost = {"failed": [1], "points": 3}
    assert tolerance(values, Bounds(high=4), judged=(0, 2), **lost)[0] == 3.0
    assert tolerance(values, Bounds(high=4), judged=(0, 1), **lost) == (None, None, True)
    missing = {"absent": [3 * FIRST], "points": 3}  # one flight of the first point
    assert tolerance(values, Bounds(high=4), judged=(1,), **missing)[0] == 2.0
    assert tolerance(values, Bounds(high=4), judged=(0,), **missing) == (None, None, True)
    more = np.arange(3.0 * SECOND) % 3 + 1.0  # one failure may be lost at each point
    assert tolerance(more, Bounds(high=4), failed=[1, 5], points=3, judged=(0, 1, 2))[0] == 3.0


def cells(folder, entries, **keys):
    """Return the two cells of the tolerance limit of each requirement."""
    models = Models(
        read_flown(
            write_campaign(
                folder / "c",
                controllers=("lqr",),
                requirements=[f"{{metric: sideslip_max_deg, {e}}}" for e in entries],
                **keys,
            )
        )
    )
    section = VERDICTS.section(models[VERDICTS], models.names)
    (table,) = (table for table in section.tables() if "Tolerance limit" in table.heads)
    first = table.heads.index("Tolerance limit")
    found = [row[first : first + 2] for row in table.plain_rows()]
    limits = [entry.controllers["lqr"].tolerance_limit for entry in models[VERDICTS].requirements]
    return found, limits


def test_cells_name_the_side_of_the_limit(tmp_path):
    entries = (
        "below: 50, probability: 0.9",
        "below: 0.001, probability: 0.9",
        "above: -50, probability: 0.9",
        "above: -50, below: 50, probability: 0.9",
        "above: 40, below: 50, probability: 0.9",
        "below: 50, probability: 0.9999",
    )
    found, limits = cells(tmp_path, entries, runs=60)
    signs = [(limit[0], room.rpartition(" ")[2]) for limit, room in found[:3]]
    assert signs == [("<", "inside"), ("<", "beyond"), (">", "inside")]
    assert found[3][0].endswith(" inside") and found[4][0].endswith(" outside")
    assert [room.rpartition(" ")[2] for _, room in found[3:5]] == ["inside", "beyond"]
    assert found[5] == ["too few flights", "—"]
    for (text, _), limit in zip(found[:5], limits, strict=False):
        number = float(text.strip("<> ").split("\N{NO-BREAK SPACE}")[0].split(" ")[0])
        assert number == pytest.approx(abs(limit) if "side" in text else limit, rel=1e-3)


def test_cells_say_that_too_many_flights_terminated_early(tmp_path):
    found, _ = cells(tmp_path, ["below: 50, probability: 0.9"], runs=60, failing=59)
    assert found == [["too many early terminations", "—"]]


@pytest.mark.parametrize("bad", ["high", "low"])
def test_without_requirements_a_row_is_scaled_by_the_median_or_the_spread(tmp_path, bad):
    results = read_flown(write_campaign(tmp_path / "c", runs=60, requirements=()))
    metric = next(name for name in results.asked if results.campaign.metrics[name].bad == "high")
    records = {**results.campaign.metrics}
    records[metric] = replace(records[metric], bad=bad)
    for middle, size in ((0.0, None), (-8.0, 8.0)):
        values = middle + np.repeat([-3.0, 0.0, 3.0], 20)
        flights = {
            name: replace(own, metrics={**own.metrics, metric: values})
            for name, own in results.flights.items()
        }
        stub = SimpleNamespace(
            flights=flights,
            controllers=results.controllers,
            campaign=SimpleNamespace(metrics=records, unknowns=results.campaign.unknowns),
        )
        row = _unlimited(stub, metric)
        assert (row.limit, row.below) == (middle, bad == "high")
        assert row.size == size if size else 2.0 < row.size <= 6.0
