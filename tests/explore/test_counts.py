"""What the browser's view counts, against numpy over the same flights."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from abhv_mc.explore import counts
from abhv_mc.explore.counts import (
    Asked,
    count_flights,
    find_flight,
    find_nearest,
    find_ranges,
    list_flights,
    open_flights,
    parse_asked,
)
from abhv_mc.io.documents import InputError
from abhv_mc.topics.failed_flights import requirement_failures

X, Y, BRUSHED = "aero.lift", "speed_error_max_mps", "atmosphere.density"


@pytest.fixture(scope="module")
def table(failing_folder):
    with open_flights(failing_folder) as opened:
        yield opened


def bins_of(values, ends, number):
    width = ((ends[1] - ends[0]) or 1.0) / number
    return np.minimum(np.floor((values - ends[0]) / width), number - 1).astype(int)


def held_of(table):
    return table.cursor().execute("select * replace (controller::varchar as controller) from shown").fetchnumpy()


def chosen_of(held, asked):
    inside = np.isin(held["controller"].astype(str), asked.controllers)
    if asked.outcome != "all":
        inside &= (held["outcome"].astype(str) == "ok") == (asked.outcome == "ok")
    for name, (low, high) in asked.brushes.items():
        inside &= (held[name] >= low) & (held[name] <= high)
    return inside


@pytest.mark.parametrize("outcome", ["all", "failed", "ok"])
def test_counts_cells_and_strips_are_those_of_the_flights(table, failing, outcome, monkeypatch):
    monkeypatch.setattr(counts, "MOST_POINTS", 0)
    low, high = table.ranges[BRUSHED]
    asked = Asked(X, Y, ("tlc", "lqr"), outcome, {BRUSHED: (low, low + 0.9 * (high - low))})
    found = count_flights(table, asked)
    cells, count, bars = {}, 0, np.zeros(counts.BARS, int)
    for k, name in enumerate(("tlc", "lqr")):
        flights = failing.flights[name]
        density, lift = (failing.samples[column][flights.flight] for column in (BRUSHED, X))
        inside = (density <= asked.brushes[BRUSHED][1]) & (~flights.failed if outcome == "ok" else
                                                           flights.failed if outcome == "failed" else True)  # fmt: skip
        count += int(inside.sum())
        across = bins_of(lift[inside], table.ranges[X], counts.CELLS[0])
        up = bins_of(flights.metrics[Y][inside], table.ranges[Y], counts.CELLS[1])
        for i, j in zip(across.tolist(), up.tolist(), strict=True):
            cells[k, i, j] = cells.get((k, i, j), 0) + 1
        bars += np.bincount(bins_of(density[inside], table.ranges[BRUSHED], counts.BARS), minlength=counts.BARS)
    assert found["count"] == count > 0
    assert {tuple(row[:3]): row[3] for row in found["cells"]} == cells
    strip = dict(found["strips"][BRUSHED])
    assert [strip.get(k, 0) for k in range(counts.BARS)] == bars.tolist()


def test_few_flights_are_points_and_the_worst_are_those_of_the_report(table, failing):
    found = count_flights(table, Asked(X, Y, ("lqr",), "all", {}))
    flights = failing.flights["lqr"]
    points = {row[3]: tuple(row[1:3]) for row in found["points"]}
    places = zip(failing.samples[X].tolist(), flights.metrics[Y].tolist(), strict=True)
    assert points == dict(enumerate(places))
    assert sum(row[4] for row in found["points"]) == 12
    order = failing.ranking.rows_of("lqr")
    assert [row[1] for row in found["rows"]] == flights.flight[order][: counts.LISTED].tolist()
    of_all = count_flights(table, Asked(X, Y, failing.controllers, "all", {}))["rows"]
    first = zip(failing.ranking.controller, failing.ranking.row, strict=True)
    assert [tuple(row[:2]) for row in of_all[:20]] == [
        (k, failing.flights[failing.controllers[k]].flight[row]) for k, row in islice(first, 20)
    ]


def test_the_flights_that_miss_a_requirement(table, failing):
    for k, item in enumerate(failing.campaign.requirements):
        missed = requirement_failures(failing.flights["lqr"], item)
        assert count_flights(table, Asked(X, Y, ("lqr",), f"missed {k}", {}))["count"] == missed.sum() > 0


@pytest.mark.parametrize("down", [False, True])
def test_they_are_listed_by_any_column_and_saved_in_that_order(table, failing, down):
    flights, speeds = failing.flights["lqr"], failing.flights["lqr"].metrics[Y]
    asked = Asked(X, Y, ("lqr",), "ok", {}, sort=Y, down=down)
    rows = [k for k in np.argsort(-speeds if down else speeds, kind="stable") if not flights.failed[k]]
    assert [row[1] for row in count_flights(table, asked)["rows"]] == flights.flight[rows][: counts.LISTED].tolist()
    heads, parts = list_flights(table, asked)
    saved = [dict(zip(heads, row, strict=True)) for part in parts for row in part]
    assert [row["flight"] for row in saved] == flights.flight[rows].tolist()
    assert [row[f"{Y} [m/s]"] for row in saved] == speeds[rows].tolist()
    assert [row[f"{X} [factor]"] for row in saved] == failing.samples[X][flights.flight[rows]].tolist()


def test_axes_that_fit_reach_as_far_as_the_chosen_flights(table, failing):
    low, high = table.ranges[BRUSHED]
    chosen = failing.samples[BRUSHED][failing.flights["lqr"].flight] < (low + high) / 2
    asked = Asked(X, Y, ("lqr",), "all", {BRUSHED: (low, (low + high) / 2)}, fit=True)
    lift, speed = failing.samples[X][failing.flights["lqr"].flight][chosen], failing.flights["lqr"].metrics[Y][chosen]
    assert [list(ends) for ends in count_flights(table, asked)["ends"]] == [
        [lift.min(), lift.max()], [speed.min(), speed.max()]
    ]  # fmt: skip


def test_one_flight_is_told_with_all_its_numbers(table, failing):
    flights = failing.flights["lqr"]
    found = find_flight(table, "lqr", 17)
    assert (found["controller"], found["flight"]) == (1, 17)
    assert found["values"][Y] == flights.metrics[Y][17] and found["values"][X] == failing.samples[X][17]
    assert found["missed"] == [bool(requirement_failures(flights, item)[17]) for item in failing.campaign.requirements]
    assert found["by"] == failing.ranking.by["lqr"][17]
    with pytest.raises(InputError, match="no flight 99999"):
        find_flight(table, "lqr", 99999)


def test_the_nearest_flight_is_the_one_of_the_place(table, failing):
    flights = failing.flights["tlc"]
    asked = Asked(X, Y, ("tlc",), "all", {})
    place = failing.samples[X][17], flights.metrics[Y][17]
    assert find_nearest(table, asked, *place) == (0, 17)
    assert find_nearest(table, Asked(X, Y, (), "all", {}), *place) is None


@pytest.mark.parametrize(
    "change",
    [{"x": 'flight" from shown; drop table shown --'}, {"y": "no_such"}, {"outcome": "or 1=1"}, {"outcome": "missed 3"},
     {"sort": "rank, (select 1)"}, {"controllers": ["pid"]},
     {"brushes": {"1=1 or x": [0, 1]}}, {"brushes": {X: ["a", 1]}}, {"brushes": 5}],
)  # fmt: skip
def test_what_the_view_never_sends_is_refused(table, change):
    sent = {
        "x": X,
        "y": Y,
        "controllers": ["tlc"],
        "outcome": "all",
        "brushes": {},
        "fit": False,
        "sort": "rank",
        "down": False,
    }
    assert parse_asked(sent, table).x == X
    with pytest.raises(InputError, match="request"):
        parse_asked(sent | change, table)


def grow(table, flights):
    """A table of so many flights, made of the ones that it holds."""
    connection = table.connection
    held, numbers = connection.execute("select count(*), max(flight) + 1 from shown").fetchone()
    columns = list(table.ranges)
    moved = ", ".join(f'"{name}" * (0.95 + 0.1 * random()) as "{name}"' for name in columns)
    copies = -(-flights // held)
    connection.execute("select setseed(0.5)")
    connection.execute(
        f"create table grown as select controller, flight + {numbers} * k as flight, outcome, "  # noqa: S608
        f"rank + {numbers} * k as rank, {moved} from shown, range({copies}) copies(k) limit {flights}"
    )
    connection.execute("drop table shown")
    connection.execute("alter table grown rename to shown")
    return replace(table, ranges=find_ranges(connection, columns))


def draw_asked(table, draw):
    """Two columns against each other, and two brushes of a tenth to all of a range."""
    names = list(table.ranges)
    x, y, *brushed = (names[k] for k in draw.integers(len(names), size=4))
    brushes = {}
    for name in brushed:
        low, high = table.ranges[name]
        width = draw.uniform(0.1, 1.0) * (high - low)
        start = draw.uniform(low, high - width)
        brushes[name] = (start, start + width)
    return Asked(x, y, tuple(entry["name"] for entry in table.view["controllers"]), "all", brushes)


@pytest.mark.thorough
def test_a_million_flights_are_counted_right(failing_folder):
    draw = np.random.default_rng(3)
    with open_flights(failing_folder) as small:
        table = grow(small, 1_000_000)
        held = held_of(table)
        assert held["flight"].size == 1_000_000
        for _ in range(6):
            asked = draw_asked(table, draw)
            inside = chosen_of(held, asked)
            found = count_flights(table, asked)
            assert found["count"] == int(inside.sum())
            if found["cells"]:
                across = bins_of(held[asked.x][inside], table.ranges[asked.x], counts.CELLS[0])
                cells = np.zeros(counts.CELLS[0], int)
                for _, i, _, number in found["cells"]:
                    cells[i] += number
                assert cells.tolist() == np.bincount(across, minlength=cells.size).tolist()
