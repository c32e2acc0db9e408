"""Quaternion algebra against scipy's rotations and against itself."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from abhv_mc.kernel.numerics import quaternion

ANGLES = st.floats(-math.pi, math.pi)
PITCHES = st.floats(-math.pi / 2, math.pi / 2)
COMPONENTS = st.floats(-1e3, 1e3)


def _scipy(yaw: float, pitch: float, roll: float) -> Rotation:
    return Rotation.from_euler("ZYX", [yaw, pitch, roll])


@given(ANGLES, PITCHES, ANGLES, COMPONENTS, COMPONENTS, COMPONENTS)
def test_rotations_are_scipys(yaw: float, pitch: float, roll: float, x: float, y: float, z: float) -> None:
    q = quaternion.from_euler(yaw, pitch, roll)
    ned = quaternion.rotate_to_ned(*q, x, y, z)
    assert ned == pytest.approx(_scipy(yaw, pitch, roll).apply([x, y, z]), abs=1e-11)
    assert quaternion.rotate_to_body(*q, *ned) == pytest.approx((x, y, z), abs=1e-11)


@given(*[st.floats(-1.0, 1.0)] * 4, st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_a_meridional_vector_turns_as_any(
    q0: float, q1: float, q2: float, q3: float, north: float, down: float
) -> None:
    short = quaternion.rotate_meridional(q0, q1, q2, q3, north, down)
    assert short == quaternion.rotate_to_body(q0, q1, q2, q3, north, 0.0, down)


def test_axes_are_the_aeronautical_ones() -> None:
    # Nose east after a yaw of 90 deg; positive pitch is nose up, positive roll right wing down.
    east = quaternion.rotate_to_ned(*quaternion.from_euler(math.pi / 2, 0.0, 0.0), 1.0, 0.0, 0.0)
    up = quaternion.rotate_to_ned(*quaternion.from_euler(0.0, math.pi / 2, 0.0), 1.0, 0.0, 0.0)
    wing = quaternion.rotate_to_ned(*quaternion.from_euler(0.0, 0.0, math.pi / 2), 0.0, 1.0, 0.0)
    assert east == pytest.approx((0.0, 1.0, 0.0), abs=1e-15)
    assert up == pytest.approx((0.0, 0.0, -1.0), abs=1e-15)
    assert wing == pytest.approx((0.0, 0.0, 1.0), abs=1e-15)


@given(ANGLES, PITCHES, ANGLES, st.tuples(*[st.floats(-2.0, 2.0)] * 3))
def test_rate_is_the_derivative_of_turning_about_body_axes(
    yaw: float, pitch: float, roll: float, rate: tuple[float, float, float]
) -> None:
    q = np.array(quaternion.from_euler(yaw, pitch, roll))
    step = 1e-4
    attitude = Rotation.from_quat(q, scalar_first=True)
    ahead, behind = (
        (attitude * Rotation.from_rotvec(sign * step * np.array(rate))).as_quat(scalar_first=True) for sign in (1, -1)
    )
    ahead, behind = (value * np.sign(np.dot(value, q)) for value in (ahead, behind))
    derivative = quaternion.quaternion_rate(*q, *rate)
    assert derivative == pytest.approx((ahead - behind) / (2 * step), abs=1e-7)
    assert np.dot(derivative, q) == pytest.approx(0.0, abs=1e-15)
