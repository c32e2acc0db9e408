"""Counts of the browser view compared with numpy over the same flights."""

from itertools import islice

import numpy as np
import pytest

from abhv_mc.io.messages import InputError
from abhv_mc.topics.missed_requirements import requirement_failures
from abhv_mc_explore import counts
from abhv_mc_explore.counts import (
    Selection,
    count_flights,
    find_flight,
    find_nearest,
    list_flights,
    open_flights,
    parse_selection,
)

X, Y, BRUSHED = "aero.lift", "speed_error_max_mps", "atmosphere.density"


@pytest.fixture(scope="module")
def table(failing_folder):
    with open_flights(failing_folder) as opened:
        yield opened


def bins_of(values, ends, number):
    width = ((ends[1] - ends[0]) or 1.0) / number
    return np.minimum(np.floor((values - ends[0]) / width), number - 1).astype(int)


@pytest.mark.parametrize("outcome", ["all", "failed", "ok"])
def test_counts_cells_and_strips_are_those_of_the_flights(table, failing, outcome, monkeypatch):
    monkeypatch.setattr(counts, "MOST_POINTS", 0)
    low, high = table.ranges[BRUSHED]
    selection = Selection(
        X, Y, ("tlc", "lqr"), outcome, {BRUSHED: (low, low + 0.95 * (high - low))}
    )
    counted = count_flights(table, selection)
    cells, count, bars = {}, 0, np.zeros(counts.BARS, int)
    for k, name in enumerate(("tlc", "lqr")):
        flights = failing.flights[name]
        density, lift = (failing.samples[column][flights.flight] for column in (BRUSHED, X))
        inside = (density <= selection.brushes[BRUSHED][1]) & (
            ~flights.failed if outcome == "ok" else flights.failed if outcome == "failed" else True
        )
        count += int(inside.sum())
        across = bins_of(lift[inside], table.ranges[X], counts.CELLS[0])
        up = bins_of(flights.metrics[Y][inside], table.ranges[Y], counts.CELLS[1])
        for i, j in zip(across.tolist(), up.tolist(), strict=True):
            cells[k, i, j] = cells.get((k, i, j), 0) + 1
        bars += np.bincount(
            bins_of(density[inside], table.ranges[BRUSHED], counts.BARS), minlength=counts.BARS
        )
    assert counted["count"] == count > 0
    assert {tuple(row[:3]): row[3] for row in counted["cells"]} == cells
    strip = dict(counted["strips"][BRUSHED])
    assert [strip.get(k, 0) for k in range(counts.BARS)] == bars.tolist()


def test_few_flights_are_points_and_the_worst_are_those_of_the_report(table, failing):
    counted = count_flights(table, Selection(X, Y, ("lqr",), "all", {}))
    flights = failing.flights["lqr"]
    points = {row[3]: tuple(row[1:3]) for row in counted["points"]}
    positions = zip(failing.samples[X].tolist(), flights.metrics[Y].tolist(), strict=True)
    assert points == dict(enumerate(positions))
    assert sum(row[4] for row in counted["points"]) == 12
    lost = count_flights(
        table, Selection(X, Y, ("lqr",), "failed", {}, fit=True)
    )  # axes that reach as far as these
    values = (failing.samples[X][flights.failed], flights.metrics[Y][flights.failed])
    assert [list(ends) for ends in lost["ends"]] == [
        [column.min(), column.max()] for column in values
    ]
    order = failing.ranking.rows_of("lqr")
    assert [row[1] for row in counted["rows"]] == flights.flight[order][: counts.LISTED].tolist()
    of_all = count_flights(table, Selection(X, Y, failing.controllers, "all", {}))["rows"]
    ranking = failing.ranking
    first = zip((ranking.controllers[k] for k in ranking.controller), ranking.row, strict=True)
    assert [(failing.controllers[row[0]], row[1]) for row in of_all[:20]] == [
        (name, failing.flights[name].flight[row]) for name, row in islice(first, 20)
    ]


@pytest.mark.parametrize("down", [False, True])
def test_they_are_listed_by_any_column_and_saved_in_that_order(table, failing, down):
    flights, speeds = failing.flights["lqr"], failing.flights["lqr"].metrics[Y]
    selection = Selection(X, Y, ("lqr",), "ok", {}, sort=Y, down=down)
    rows = [
        k for k in np.argsort(-speeds if down else speeds, kind="stable") if not flights.failed[k]
    ]
    assert [row[1] for row in count_flights(table, selection)["rows"]] == flights.flight[rows][
        : counts.LISTED
    ].tolist()
    heads, parts = list_flights(table, selection)
    saved = [dict(zip(heads, row, strict=True)) for chunk in parts for row in chunk]
    assert [row["flight"] for row in saved] == flights.flight[rows].tolist()
    assert [row[f"{Y} [m/s]"] for row in saved] == speeds[rows].tolist()
    assert [row[f"{X} [factor]"] for row in saved] == failing.samples[X][
        flights.flight[rows]
    ].tolist()


def test_one_flight_is_told_with_all_its_numbers_and_found_by_its_place(table, failing):
    flights = failing.flights["lqr"]
    entry = find_flight(table, "lqr", 17)
    assert (entry["controller"], entry["flight"]) == (1, 17)
    assert (
        entry["values"][Y] == flights.metrics[Y][17]
        and entry["values"][X] == failing.samples[X][17]
    )
    assert entry["missed"] == [
        bool(requirement_failures(flights, item)[17]) for item in failing.campaign.requirements
    ]
    assert entry["by"] == failing.ranking.criterion_index["lqr"][17]
    with pytest.raises(InputError, match=r"\b99999\b"):
        find_flight(table, "lqr", 99999)
    position = entry["values"][X], entry["values"][Y]
    assert find_nearest(table, Selection(X, Y, ("lqr",), "all", {}), *position) == (1, 17)
    assert find_nearest(table, Selection(X, Y, (), "all", {}), *position) is None
    for k, item in enumerate(failing.campaign.requirements):
        missed = requirement_failures(flights, item)
        assert (
            count_flights(table, Selection(X, Y, ("lqr",), f"missed {k}", {}))["count"]
            == missed.sum()
            > 0
        )


@pytest.mark.parametrize(
    "change",
    [{"x": 'flight" from shown; drop table shown --'}, {"y": "no_such"},
     {"outcome": "or 1=1"}, {"outcome": "missed 3"},
     {"sort": "rank, (select 1)"}, {"controllers": ["pid"]},
     {"brushes": {"1=1 or x": [0, 1]}}, {"brushes": {X: ["a", 1]}}, {"brushes": 5}],
)  # fmt: skip
def test_what_the_view_never_sends_is_refused(table, change):
    order = {"outcome": "all", "brushes": {}, "fit": False, "sort": "rank", "down": False}
    sent = {"x": X, "y": Y, "controllers": ["tlc"], **order}
    assert parse_selection(sent, table).x == X
    with pytest.raises((InputError, ValueError)):
        parse_selection(sent | change, table)
