from itertools import product

import numpy as np
import pytest

from abhv_mc.search.methods.evaluation import Record, round_up
from abhv_mc.search.methods.worst import (
    _suggest,
    explore,
    find_top,
    least_evaluations,
    search_worst,
)


def bowl(dimension, sharpness=2.0):
    """Return a rotated, stretched bowl and the location of its maximum, inside the box.

    A sharpness of 2 is a parabola; a smaller value gives a sharper peak.
    """
    draw = np.random.default_rng(dimension)
    top = draw.uniform(-0.7, 0.7, dimension)
    turn, _ = np.linalg.qr(draw.standard_normal((dimension, dimension)))
    stretch = np.geomspace(1.0, 10.0, dimension)
    return lambda x: -((((x - top) @ turn) ** 2 @ stretch) ** (0.5 * sharpness)), top


def slope(dimension):
    """A rising plane with waves on it: the top is a corner, other corners are local tops."""
    draw = np.random.default_rng(dimension + 1)
    weights = draw.uniform(0.1, 1.0, dimension) * draw.choice([-1.0, 1.0], dimension)
    return lambda x: x @ weights + 0.05 * np.sin(np.pi * (x**2 - 0.5)).sum(axis=1), np.sign(weights)


@pytest.mark.parametrize("dimension", [3, 12])
@pytest.mark.parametrize("sharpness, gap", [(2.0, 1e-4), (1.5, 5e-3), (3.0, 1e-4)])
def test_finds_a_top_inside(dimension, sharpness, gap):
    value, top = bowl(dimension, sharpness)
    worst_case = search_worst(value, dimension, seed=0)
    drawn = value(np.random.default_rng(1).uniform(-1.0, 1.0, (10_000, dimension)))
    assert worst_case.value > -gap * (drawn.max() - drawn.min())
    assert np.abs(worst_case.place - top).max() < {3: 0.01, 12: 0.1}[dimension]
    assert not worst_case.at_bounds.any()


@pytest.mark.parametrize("dimension", [1, 3, 12])
def test_finds_a_corner(dimension):
    value, corner = slope(dimension)
    worst_case = search_worst(value, dimension, seed=0)
    np.testing.assert_array_equal(worst_case.place, corner)
    assert worst_case.at_bounds.all()


def test_what_changes_nothing_sits_on_no_end():
    worst_case = search_worst(
        lambda points: np.minimum(points[:, 0], 0.9) + points[:, 1], 3, seed=0
    )
    assert worst_case.at_bounds.tolist() == [False, True, False]


@pytest.mark.parametrize("seed", [1, 3, 6])
def test_finds_a_corner_behind_a_broad_hill(seed):
    """Check a hill that dominates most of the box, with a higher corner."""
    dimension = 12
    draw = np.random.default_rng(seed)
    corner, top = draw.choice([-1.0, 1.0], dimension), draw.uniform(-0.3, 0.3, dimension)

    def value(x):
        return np.maximum(
            1.0 - ((x - top) ** 2).mean(axis=1), 1.3 - (1.0 - x * corner).mean(axis=1)
        )

    worst_case = search_worst(value, dimension, seed=seed)
    np.testing.assert_array_equal(worst_case.place, corner)


def test_batches_fill_lanes_and_stay_within_what_is_allowed():
    value, _ = slope(5)
    sizes = []

    def counted(points):
        sizes.append(len(points))
        assert np.abs(points).max() <= 1.0
        return value(points)

    worst_case = search_worst(counted, 5, 1000)
    assert all(size % 32 == 0 for size in sizes)
    assert sum(sizes) == len(worst_case.values) == worst_case.history[-1].evaluations <= 1000
    assert [progress.best for progress in worst_case.history] == sorted(
        progress.best for progress in worst_case.history
    )
    assert value(worst_case.place[None, :])[0] == pytest.approx(worst_case.value, rel=1e-14)
    assert {progress.stage for progress in worst_case.history} == {
        "one at a time", "corners", "Sobol points", "CMA-ES", "polish", "sensitivity"
    }  # fmt: skip


def test_stages_have_their_shares_of_the_evaluations():
    """With 2000 evaluations, batches have 128 points: a quarter for polishing is left."""
    worst_case = search_worst(bowl(2)[0], 2, 2000)
    last = {progress.stage: progress.evaluations for progress in worst_case.history}
    stages = "one at a time", "corners", "Sobol points", "CMA-ES"
    assert [last[stage] for stage in stages] == [128, 256, 512, 1408]
    assert last["sensitivity"] == last["polish"] + 32 <= 2000
    assert {*map(tuple, worst_case.points[128:132])} == {*product((-1.0, 1.0), repeat=2)}


def test_values_that_are_no_numbers_are_never_the_worst():
    def value(x):
        return np.where(x[:, 0] > 0.5, np.nan, x.sum(axis=1))

    worst_case = search_worst(value, 3, 1500, seed=2)
    assert worst_case.value == pytest.approx(2.5, abs=0.05)
    assert worst_case.place[0] <= 0.5


def test_sensitivity_about_the_worst():
    worst_case = search_worst(lambda x: 3.0 * x[:, 0] - (x[:, 1] - 0.2) ** 2, 2, 1000)
    assert worst_case.sensitivity[0, 0] == pytest.approx(-0.3)
    assert np.isnan(worst_case.sensitivity[0, 1])
    np.testing.assert_allclose(worst_case.sensitivity[1], -0.01, atol=1e-3)


def test_a_record_keeps_the_best_value_and_distinct_places():
    draw = np.random.default_rng(1)
    batches = draw.uniform(-1.0, 1.0, (3, 40, 2))
    record = Record(lambda x: np.where(x[:, 0] > 0.9, np.nan, x.sum(axis=1)), 200)
    returned = [record.call(points, f"stage {k}") for k, points in enumerate(batches)]
    points = batches.reshape(-1, 2)
    values = np.where(points[:, 0] > 0.9, -np.inf, points.sum(axis=1))
    np.testing.assert_array_equal(np.concatenate(returned), values)
    assert (record.used, record.left, record.best) == (120, 80, values.max())
    assert np.array_equal(record.place, points[values.argmax()])
    best = np.maximum.accumulate([own.max() for own in returned])
    assert [(p.evaluations, p.best, p.stage) for p in record.history] == [
        (40 * (k + 1), best[k], f"stage {k}") for k in range(3)
    ]
    expected = []
    for point in points[np.argsort(-values)]:
        if all(np.mean((point - other) ** 2) >= 0.3**2 for other in expected):
            expected.append(point)
    assert np.array_equal(record.best_places(4, 0.3), expected[:4]) and len(expected) > 4
    assert [round_up(n) for n in (0, 1, 32, 33)] == [0, 32, 32, 64] and round_up(5, 4) == 8


def test_corners_are_tried_from_the_slopes_and_then_from_the_opposite():
    """Ten dimensions have more corners than are all tried; the least slope changes sign first."""
    weights = np.array([3.0, -1.0, 2.0, -5.0, 4.0, 0.5, -0.1, 6.0, 0.7, -8.0])
    record = Record(lambda x: x @ weights, 2000)
    explore(record, 10, 0, 128)
    star, first, second, *_ = record.points
    assert np.array_equal(star[:21], np.vstack([np.zeros((1, 10)), np.eye(10), -np.eye(10)]))
    order, corner = np.argsort(np.abs(weights)), np.sign(weights)
    flips = [[], *([i] for i in order), *([i, j] for k, i in enumerate(order) for j in order[:k])]
    for start, points in ((corner, first), (-corner, second)):
        expected = np.tile(start, (56, 1))
        for row, changed in zip(expected, flips, strict=True):
            row[changed] *= -1.0
        assert np.array_equal(points[:56], expected)
    stages = [progress.stage for progress in record.history]
    corners = [p for p, stage in zip(record.points, stages, strict=True) if stage == "corners"]
    tried = [tuple(row) for p in corners for row in p if (np.abs(row) == 1.0).all()]
    assert len({*tried}) == len(tried) and record.best == np.abs(weights).sum()
    assert record.used == 640 and np.abs(np.concatenate(record.points)).max() <= 1.0


@pytest.mark.parametrize(
    ("radius", "expected"),
    [
        (2.0, [0.3, -0.2]),  # the top of the quadratic
        (0.1, [0.1, -0.1]),  # the bounds of the neighbourhood
    ],
)
def test_the_top_of_a_fitted_quadratic_is_within_its_radius(radius, expected):
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (60, 2))
    matrix = np.array([[4.0, 0.6], [0.6, 2.0]])
    moved = points - [0.3, -0.2]
    values = 5.0 - np.einsum("pi,ij,pj->p", moved, matrix, moved)
    for spread in (1.2, 4.0, 10.0):
        top = find_top(points, values, np.zeros(2), radius, spread)
        assert top == pytest.approx(expected, abs=1e-5)
    far = find_top(points, points @ [1.0, -2.0], np.array([0.8, -0.9]), 0.5, 4.0)
    assert far == pytest.approx([1.0, -1.0])


def test_the_least_number_of_evaluations_follows_from_batches():
    assert [least_evaluations(*pair) for pair in ((3, 160), (40, 2000), (3, 10**6))] == [
        2 * 64 + 32,
        2 * 128 + 96,
        2 * 512 + 32,
    ]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_slopes_and_parabolas_suggest_the_next_points(sign):
    """Two parabolas have their tops at 0.4 and -0.27; the third dimension is at its bound."""
    center, step = sign * np.array([0.2, -0.3, 1.0]), 0.1

    def value(points):
        x = sign * points
        return -((x[:, 0] - 0.4) ** 2) - 2.0 * (x[:, 1] + 0.27) ** 2 + x[:, 2]

    compass = np.clip(np.vstack([center + step * np.eye(3), center - step * np.eye(3)]), -1.0, 1.0)
    (best,) = value(center[None])
    newton, better, *_, corner = _suggest(center, best, compass, value(compass), step)
    assert sign * newton == pytest.approx([0.4, -0.27, 1.4])  # a slope gives four steps
    assert sign * better == pytest.approx([0.3, -0.3, 1.0])
    assert sign * corner == pytest.approx([1.0, 1.0, 1.0])
