"""Tests of the dispersions of a campaign as a box, and of the worst flights.

A parameter with a probability is searched conditionally on its occurrence.
"""

import numpy as np
import pytest
from fake_flight import write_campaign
from scipy import stats

from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flights import END_TIME, FlightRows
from abhv_mc.io.messages import InputError
from abhv_mc.search.search_flights import (
    ENDED_EARLY,
    FAILS_ABOVE,
    Severity,
    ended_early,
    not_computed,
    rank_distinct,
)
from abhv_mc.search.space import make_space
from abhv_mc.statistics.estimates import Criterion

DISPERSIONS = """{failure.aileron.stuck_time: {distribution: uniform, low: 10 s, high: 40 s, \
probability: 40 %},
  aero.drag: {distribution: normal, sigma: 2 %, probability: 30 %},
  aero.lift: {distribution: normal, sigma: 5 %}}"""


def test_what_comes_with_a_probability_has_the_box_of_what_it_is_when_it_comes(tmp_path):
    """Check that the search includes failures.

    The box of a failure extended to infinity, so no flight of the search had one.
    """
    space = make_space(
        read_campaign(write_campaign(tmp_path, dispersions=DISPERSIONS, requirements="[]"))
    )
    columns = {name: i for i, name in enumerate(space.names)}
    time, drag = columns["failure.aileron.stuck_time"], columns["aero.drag"]
    bounds = space.bounds(3.0)
    np.testing.assert_allclose(bounds[time], [10.0, 40.0])
    np.testing.assert_allclose(bounds[drag], [0.94, 1.06], rtol=1e-6)
    corners = np.array([[-1.0] * 3, [0.0] * 3, [1.0] * 3])
    np.testing.assert_allclose(space.from_box(corners, bounds)[:, time], [10.0, 25.0, 40.0])
    drawn = space.draw_in_box(bounds, 7, 4000)
    comes = np.isfinite(drawn[:, time])
    assert abs(comes.mean() - 0.4) < 0.03, (
        "the random flights are as a campaign's: most without a failure"
    )
    assert drawn[comes, time].min() >= 10.0 and drawn[comes, time].max() <= 40.0
    assert abs((drawn[:, drag] == 1.0).mean() - 0.7) < 0.03


def test_points_become_values_by_distributions_and_chosen_switches(tmp_path):
    pairs = "[{between: [aero.lift, atmosphere.density], normal: 0.6}]"
    laws = (
        DISPERSIONS[:-1] + ",\n  atmosphere.density: {distribution: uniform, low: 0.9, high: 1.1}}"
    )
    entries = {"dispersions": laws, "correlations": pairs, "requirements": "[]"}
    space = make_space(read_campaign(write_campaign(tmp_path, **entries)))
    time, drag, lift, density = (
        space.names.index(name)
        for name in ("failure.aileron.stuck_time", "aero.drag", "aero.lift", "atmosphere.density")
    )
    assert space.probabilities == {"failure.aileron.stuck_time": 0.4, "aero.drag": 0.3}
    points = np.random.default_rng(1).standard_normal((200, 4))
    first, second = sorted((lift, density))
    normal = points.copy()
    normal[:, second] = 0.6 * points[:, first] + 0.8 * points[:, second]
    shares = stats.norm.cdf(normal)
    on = np.random.default_rng(2).random((200, 2)) < 0.5
    switch = [*space.probabilities]
    for chosen in (None, on):
        values = space.from_normal(points, chosen)
        assert values[:, lift] == pytest.approx(1.0 + 0.05 * normal[:, lift])
        assert values[:, density] == pytest.approx(0.9 + 0.2 * shares[:, density])
        for column, drawn, nominal, share in (
            (time, lambda p: 10.0 + 30.0 * p, np.inf, 0.4),
            (drag, lambda p: stats.norm.ppf(p, 1.0, 0.02), 1.0, 0.3),
        ):
            own = values[:, column]
            if chosen is None:
                assert np.mean(own != nominal) == pytest.approx(share, abs=0.1)
            else:
                comes = on[:, switch.index(space.names[column])]
                assert (own[~comes] == nominal).all()
                assert own[comes] == pytest.approx(drawn(shares[comes, column]))


def test_seeds_are_common_or_those_of_the_numbers_of_flights(tmp_path):
    laws = "{wind.turbulence: {distribution: uniform, low: 0 m/s, high: 2 m/s}}"
    path = write_campaign(tmp_path, dispersions=laws, requirements="[]")
    space = make_space(read_campaign(path))
    assert space.columns == ("wind.turbulence", "wind.turbulence_seed")
    values = np.linspace(0.0, 2.0, 6)[:, None]
    whole, common = space.complete(values, 3, 0), space.complete(values, 3, None)
    assert np.array_equal(whole[:, :1], values) and np.array_equal(common[:, :1], values)
    assert len({*whole[:, 1]}) == 6 and {*common[:, 1]} == {whole[0, 1]}
    assert np.array_equal(space.complete(values[2:], 3, 2), whole[2:])
    assert space.complete(values, 4, 0)[0, 1] != whole[0, 1]
    rows = space.rows(whole)
    assert rows.shape == (6, len(space.parameters.records))
    nominal = space.parameters.nominal_of([record.name for record in space.parameters.records])
    changed = {space.parameters.records[i].name for i in np.flatnonzero((rows != nominal).any(0))}
    assert changed == {*space.columns}


@pytest.mark.parametrize(
    ("bad", "limits", "excess"),
    [
        ("high", None, [3.0, -1.0, 5.0, 2.0]),
        ("low", None, [-3.0, 1.0, -5.0, -2.0]),
        ("high", Bounds(high=2.0), [1.0, -3.0, 3.0, 0.0]),
    ],
)
def test_severities_of_early_ends_exceed_all_values_and_of_failed_runs_none(bad, limits, excess):
    values = np.array([3.0, -1.0, 5.0, 2.0, np.nan])
    ends = np.array([9.0, 9.0, 4.0, 9.0, 9.0])
    early, failed = Outcome.SIDESLIP_LIMIT.code, Outcome.FAILED_TO_RUN.code
    outcome = (Outcome.OK.code, Outcome.OK.code, early, failed, Outcome.OK.code)
    columns = "m", END_TIME.name
    rows = FlightRows("c", 0, (), np.empty((5, 0)), outcome, np.stack([values, ends], 1), columns)
    assert ended_early(rows).tolist() == [False, False, True, False, False]
    assert not_computed(rows).tolist() == [False, False, False, True, False]
    for early_is_worse in (True, False):
        severity = Severity(Criterion("m", bad, limits), 9.0, early_is_worse)
        third = ENDED_EARLY + 9.0 - 4.0 if early_is_worse else excess[2]
        expected = np.array([*excess[:2], third, np.nan, ENDED_EARLY])
        np.testing.assert_array_equal(severity.of(rows), expected)
        expected[3] = -np.inf
        np.testing.assert_array_equal(severity.ranked(rows), expected)
    assert -1e-300 < FAILS_ABOVE < 0.0  # A flight at the limit fails.


@pytest.mark.parametrize(
    ("entries", "with_unknowns", "problem"),
    [
        ({"dispersions": "{}"}, True, "dispersions"),
        ({"unknowns": "{aero.drag: {low: -10 %, high: 10 %}}"}, False, "unknowns"),
        ({"unknowns": "{aero.drag: {low: -10 %, high: 20 %}}"}, True, None),
    ],
)
def test_unknowns_are_uniform_dimensions_only_where_they_are_included(
    tmp_path, entries, with_unknowns, problem
):
    campaign = read_campaign(write_campaign(tmp_path, **entries, requirements="[]"))
    if problem:
        with pytest.raises(InputError, match=problem):
            make_space(campaign, with_unknowns)
        return
    space = make_space(campaign, with_unknowns)
    assert space.names == ("atmosphere.density", "aero.lift", "aero.drag")
    bounds = space.bounds(2.0)
    np.testing.assert_allclose(bounds, [[0.9, 1.1], [0.9, 1.1], [0.9, 1.2]])
    middle = space.from_box(np.array([[0.0, -0.5, 1.0]]), bounds)
    np.testing.assert_allclose(middle, [[1.0, 0.95, 1.2]])


def test_a_mixtures_box_has_the_ends_of_its_parts_however_rare(tmp_path):
    parts = "[{distribution: normal, sigma: 2 %}, {distribution: normal, mean: 1.5, sigma: 1 %},"
    parts += " {distribution: uniform, low: 0.9, high: 1}]"
    law = f"{{distribution: mixture, parts: {parts}, weights: [1, 1e-9, 1]}}"
    space = make_space(
        read_campaign(
            write_campaign(tmp_path, dispersions=f"{{aero.drag: {law}}}", requirements="[]")
        )
    )
    np.testing.assert_allclose(space.bounds(3.0), [[0.9, 1.53]], rtol=1e-9)
    np.testing.assert_allclose(space.bounds(6.0), [[0.88, 1.56]], rtol=1e-9)


def test_a_box_in_which_no_random_flight_lies_is_refused(tmp_path):
    """The search flew, and then drew for ever."""
    names = (
        "aero.lift",
        "aero.drag",
        "aero.side_force",
        "mass.total",
        "mass.inertia_xx",
        "mass.inertia_yy",
    )
    laws = ", ".join(f"{name}: {{distribution: normal, sigma: 2 %}}" for name in names)
    space = make_space(
        read_campaign(write_campaign(tmp_path, dispersions=f"{{{laws}}}", requirements="[]"))
    )
    assert len(space.draw_in_box(space.bounds(1.0), 1, 1000)) == 1000
    with pytest.raises(InputError, match=r"^--box: .*\b0 of 66\u202f000\b"):
        space.draw_in_box(space.bounds(0.1), 1, 1000)


REPEATED = [0, 5, 5, -np.inf, 2], [[0], [1], [1], [3], [4]]
SELDOM = [
    [np.inf, 1],
    [np.inf, 1.001],
    [np.inf, 2],
    [10, 1],
    [40, 1],
    [np.inf, 1],
]  # times of a failure, and another


@pytest.mark.parametrize(
    ("severities", "samples", "number", "min_distance", "ranked"),
    [
        (*REPEATED, 5, 0.0, [1, 4, 0]),  # the same but once, uncomputed: never
        (*REPEATED, 2, 0.0, [1, 4]),
        (
            [1, 4, 3, 2],
            [[0, 1e-3], [10, 0], [9.8, 0], [5, 0]],
            4,
            0.1,
            [1, 3, 0],
        ),  # in parts of the range
        # With a worst flight without a failure it was the only one listed, with one that had it
        # none was without.
        ([6, 5, 4, 3, 2, 1], SELDOM, 6, 0.05, [0, 2, 3, 4]),
        ([1, 2, 3, 4, 5, 6], SELDOM, 6, 0.05, [5, 4, 3, 2]),
    ],
)
def test_the_worst_flights_that_lie_apart(severities, samples, number, min_distance, ranked):
    with np.errstate(all="raise"):
        assert (
            rank_distinct(
                np.array(severities, float), np.array(samples, float), number, min_distance
            )
            == ranked
        )
