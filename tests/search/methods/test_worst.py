import numpy as np
import pytest

from abhv_mc.search.methods.worst import _suggest, search_worst


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
