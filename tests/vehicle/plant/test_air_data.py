"""Flow angles abreast: the quick way that most flights take gives the bits of the general one."""

import math

import mpmath
import numpy as np
import pytest

from abhv_mc_vehicle.kernel.jit import kernel
from abhv_mc_vehicle.kernel.numerics.lane_math import TAN_EIGHTH_PI
from abhv_mc_vehicle.kernel.plant.air_data import flow_angles, flow_direction
from abhv_mc_vehicle.kernel.plant.state import COS_ALPHA, COS_BETA, LAW, SIN_ALPHA, SIN_BETA

ALPHA, BETA = 0, 1  # rows that the air data do not need


@kernel
def angles_of(velocities, angles):
    """Angles [2, flight] of velocities [flight, 3], all abreast."""
    width = velocities.shape[0]
    Z = np.zeros((LAW, width))
    for lane in range(width):
        u, v, w = velocities[lane, 0], velocities[lane, 1], velocities[lane, 2]
        _, _, Z[SIN_ALPHA, lane], Z[COS_ALPHA, lane], Z[SIN_BETA, lane], Z[COS_BETA, lane] = (
            flow_direction(u, v, w)
        )
    flow_angles(Z, width, ALPHA, BETA)
    for lane in range(width):
        angles[0, lane] = Z[ALPHA, lane]
        angles[1, lane] = Z[BETA, lane]


def look(velocities):
    angles = np.empty((2, len(velocities)))
    angles_of(np.ascontiguousarray(velocities), angles)
    return angles


def draw_ahead(flights=200):
    """Air from ahead, up to the very edge of what is taken as such."""
    generator = np.random.default_rng(2)
    edge = TAN_EIGHTH_PI * np.array([1.0 - 1e-15, 1.0, 1.0 + 1e-15])
    slopes = np.concatenate([generator.uniform(-0.41, 0.41, flights), edge, -edge, [0.0, -0.0]])
    u = np.full(len(slopes), 1400.0)
    return np.column_stack([u, u * generator.permutation(slopes), u * slopes])


def test_an_angle_does_not_depend_on_the_neighbours():
    ahead = draw_ahead()
    alone = np.column_stack([look(row[None]) for row in ahead])
    beside = look(np.concatenate([ahead, [[0.0, 1400.0, 0.0]]]))[
        :, :-1
    ]  # one in a flow from the side
    assert [repr(a) for a in alone.ravel()] == [repr(a) for a in beside.ravel()]  # -0.0, too


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_angles_are_those_of_the_velocity(turned):
    anywhere = np.random.default_rng(3).normal(0.0, 500.0, (300, 3))
    velocities = np.concatenate(
        [draw_ahead(), anywhere, np.diag([0.0, 9.0, 9.0])]
    )  # at rest and in vertical fall, too
    velocities[:, 0] *= turned
    alpha, beta = look(velocities)
    for i, (u, v, w) in enumerate(velocities.tolist()):
        exact = (
            math.copysign(float(mpmath.atan2(w, u)), w),
            mpmath.atan2(v, mpmath.hypot(u, w)),
        )  # mpmath has no -0.0
        assert alpha[i] == pytest.approx(exact[0], abs=1e-15, rel=1e-15)
        assert beta[i] == pytest.approx(float(exact[1]), abs=1e-15, rel=1e-15)
