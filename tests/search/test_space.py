"""A campaign's dispersions as a box: what comes with a probability is searched where it comes; the worst flights."""

import numpy as np
import pytest
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.documents import InputError
from abhv_mc.search.severity import rank_distinct
from abhv_mc.search.space import make_space

DISPERSIONS = """{failure.aileron.stuck_time: {distribution: uniform, low: 10 s, high: 40 s, probability: 40 %},
  aero.drag: {distribution: normal, sigma: 2 %, probability: 30 %},
  aero.lift: {distribution: normal, sigma: 5 %}}"""


def test_what_comes_with_a_probability_has_the_box_of_what_it_is_when_it_comes(tmp_path):
    """A failure's box reached to infinity: no flight of the search had one, and the worst case was a survivable one."""
    space = make_space(read_campaign(write_campaign(tmp_path, dispersions=DISPERSIONS, requirements="[]")))
    place = {name: i for i, name in enumerate(space.names)}
    time, drag = place["failure.aileron.stuck_time"], place["aero.drag"]
    bounds = space.bounds(3.0)
    np.testing.assert_allclose(bounds[time], [10.0, 40.0])
    np.testing.assert_allclose(bounds[drag], [0.94, 1.06], rtol=1e-6)
    corners = np.array([[-1.0] * 3, [0.0] * 3, [1.0] * 3])
    np.testing.assert_allclose(space.from_box(corners, bounds)[:, time], [10.0, 25.0, 40.0])
    drawn = space.draw_in_box(bounds, 7, 4000)
    comes = np.isfinite(drawn[:, time])
    assert abs(comes.mean() - 0.4) < 0.03, "the random flights are as a campaign's: most without a failure"
    assert drawn[comes, time].min() >= 10.0 and drawn[comes, time].max() <= 40.0
    assert abs((drawn[:, drag] == 1.0).mean() - 0.7) < 0.03


def test_a_mixtures_box_has_the_ends_of_its_parts_however_rare(tmp_path):
    parts = "[{distribution: normal, sigma: 2 %}, {distribution: normal, mean: 1.5, sigma: 1 %},"
    parts += " {distribution: uniform, low: 0.9, high: 1}]"
    law = f"{{distribution: mixture, parts: {parts}, weights: [1, 1e-9, 1]}}"
    space = make_space(read_campaign(write_campaign(tmp_path, dispersions=f"{{aero.drag: {law}}}", requirements="[]")))
    np.testing.assert_allclose(space.bounds(3.0), [[0.9, 1.53]], rtol=1e-9)
    np.testing.assert_allclose(space.bounds(6.0), [[0.88, 1.56]], rtol=1e-9)


def test_a_box_in_which_no_random_flight_lies_is_refused(tmp_path):
    """The search flew, and then drew for ever."""
    names = ("aero.lift", "aero.drag", "aero.side_force", "mass.total", "mass.inertia_xx", "mass.inertia_yy")
    laws = ", ".join(f"{name}: {{distribution: normal, sigma: 2 %}}" for name in names)
    space = make_space(read_campaign(write_campaign(tmp_path, dispersions=f"{{{laws}}}", requirements="[]")))
    assert len(space.draw_in_box(space.bounds(1.0), 1, 1000)) == 1000
    with pytest.raises(InputError, match=r"--box: a box with 0 of 66000"):
        space.draw_in_box(space.bounds(0.1), 1, 1000)


def test_flights_with_the_same_samples_count_once_and_uncomputed_ones_never():
    samples = np.array([[0.0], [1.0], [1.0], [3.0], [4.0]])
    assert rank_distinct(np.array([0.0, 5.0, 5.0, -np.inf, 2.0]), samples, 5) == [1, 4, 0]
    assert rank_distinct(np.array([0.0, 5.0, 5.0, -np.inf, 2.0]), samples, 2) == [1, 4]


def test_each_lies_apart_from_all_worse_ones_in_parts_of_the_range():
    samples = np.array([[0.0, 1e-3], [10.0, 0.0], [9.8, 0.0], [5.0, 0.0]])  # second column: 10 % of the rms and more
    assert rank_distinct(np.array([1.0, 4.0, 3.0, 2.0]), samples, 4, apart=0.1) == [1, 3, 0]


def test_a_failure_that_never_comes_is_far_from_those_that_do_and_no_reason_to_drop_a_flight():
    """Of a worst flight without a failure it was the only one in the list, of one with a failure none was without."""
    never = np.inf
    samples = np.array([[never, 1.0], [never, 1.001], [never, 2.0], [10.0, 1.0], [40.0, 1.0], [never, 1.0]])
    severities = np.array([6.0, 5.0, 4.0, 3.0, 2.0, 1.0])
    with np.errstate(all="raise"):
        assert rank_distinct(severities, samples, 6, apart=0.05) == [0, 2, 3, 4]
        assert rank_distinct(severities[::-1].copy(), samples, 6, apart=0.05) == [5, 4, 3, 2]
        assert rank_distinct(severities[:2], samples[:2], 2) == [0, 1]
