import numpy as np
import pytest

from abhv_mc.search.methods.polish import find_top


def ridge(dimension):
    """A concave quadratic whose axes lie across the dimensions', and its top."""
    draw = np.random.default_rng(dimension)
    turn, _ = np.linalg.qr(draw.standard_normal((dimension, dimension)))
    top = draw.uniform(-0.4, 0.4, dimension)
    stretch = np.geomspace(1.0, 100.0, dimension)
    return lambda x: 7.0 - ((x - top) @ turn) ** 2 @ stretch, top


@pytest.mark.parametrize("dimension", [1, 2, 6])
def test_finds_the_top_of_a_quadratic_from_afar(dimension):
    value, top = ridge(dimension)
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (200, dimension))
    np.testing.assert_allclose(find_top(points, value(points), np.full(dimension, 0.8), 2.0), top, atol=0.01)


def test_stays_within_the_radius_and_the_box():
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (100, 2))
    place = np.array([0.9, 0.0])
    found = find_top(points, points @ np.array([1.0, -2.0]), place, 0.3)
    np.testing.assert_allclose(found, [1.0, -0.3])
