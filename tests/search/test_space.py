"""Tests of the dispersions of a campaign as a box, and of the worst flights.

A parameter with a probability is searched conditionally on its occurrence.
"""

import numpy as np
import pytest
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.messages import InputError
from abhv_mc.search.search_flights import rank_distinct
from abhv_mc.search.space import make_space

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
