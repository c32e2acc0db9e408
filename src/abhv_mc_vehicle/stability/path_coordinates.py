"""Path coordinates of a flight relative to the Earth, and their rates.

The ten coordinates are geodetic altitude, speed, flight path angle, heading, angle of attack,
sideslip, bank and the body rates. The attitude is the attitude of the path (3-2-1 angles: heading,
flight path angle, bank), rotated about the z axis by minus the sideslip and about the y axis by the
angle of attack. Units are SI and radians; the first dimension is the point.
"""

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.user_code.law_interface import Measured

COORDINATES = Measured._fields[:10]
UNITS = ("m", "m/s", *["rad"] * 5, *["rad/s"] * 3)
ALTITUDE, SPEED, GAMMA, CHI, ALPHA, BETA, BANK, P, Q, R = range(10)
CONTROLS = (s.AILERON, s.RUDDER, s.ELEVATOR, s.ETA)


def make_states(path: Floats, controls: Floats, latitude: Floats, mass: Floats) -> Floats:
    """Return plant states [point, state] from path coordinates and actuator positions.

    `path` has shape [point, 10] and `controls` [point, 4]; the longitude is 0.
    """
    x = np.zeros((len(path), s.N_STATES))
    V = path[:, SPEED]
    alpha = path[:, ALPHA]
    beta = path[:, BETA]
    x[:, s.ALTITUDE] = path[:, ALTITUDE]
    x[:, s.LATITUDE] = latitude
    x[:, s.MASS] = mass
    x[:, s.U] = V * np.cos(beta) * np.cos(alpha)
    x[:, s.V] = V * np.sin(beta)
    x[:, s.W] = V * np.cos(beta) * np.sin(alpha)
    turns = [(path[:, CHI], 3), (path[:, GAMMA], 2), (path[:, BANK], 1), (-beta, 3), (alpha, 2)]
    attitude = np.zeros((len(path), 4))
    attitude[:, 0] = 1.0
    for angle, axis in turns:
        attitude = _turned(attitude, angle, axis)
    x[:, s.Q0 : s.Q3 + 1] = attitude
    x[:, s.ROLL_RATE : s.YAW_RATE + 1] = path[:, P:]
    x[:, CONTROLS] = controls
    return x


def make_path(states: Floats) -> Floats:
    """Return path coordinates [point, 10] of plant states [point, state]."""
    return _motion(states, np.zeros((len(states), s.AILERON)))[0]


def path_rates(states: Floats, rates: Floats) -> Floats:
    """Return rates [point, 10] of path coordinates from state rates [point, 14]."""
    return _motion(states, rates)[1]


def _turned(quaternion: Floats, angle: Floats, axis: int) -> Floats:
    """Return the quaternion rotated about its own body axis 1, 2 or 3."""
    cosine = np.cos(0.5 * angle)
    sine = np.sin(0.5 * angle)
    q = quaternion.T
    # the two axes after the rotation axis, in right-handed order
    j = axis % 3 + 1
    k = (axis + 1) % 3 + 1
    turned = np.empty_like(q)
    turned[0] = q[0] * cosine - q[axis] * sine
    turned[axis] = q[0] * sine + q[axis] * cosine
    turned[j], turned[k] = q[j] * cosine + q[k] * sine, q[k] * cosine - q[j] * sine
    return turned.T


def _axes(attitude: Floats) -> Floats:
    """Return the rotation matrix [3, 3, point] from body axes to north, east and down."""
    a, b, c, d = attitude
    return np.array(
        [
            [a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)],
            [2.0 * (b * c + a * d), a * a - b * b + c * c - d * d, 2.0 * (c * d - a * b)],
            [2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a - b * b - c * c + d * d],
        ]
    )


def _motion(states: Floats, rates: Floats) -> tuple[Floats, Floats]:
    x = states.T
    dx = rates.T
    v = x[s.U : s.W + 1]
    dv = dx[s.U : s.W + 1]
    q = x[s.Q0 : s.Q3 + 1]
    dq = dx[s.Q0 : s.Q3 + 1]
    C = _axes(q)
    # The matrix is quadratic in the quaternion, so any central difference is exact.
    dC = 0.5 * (_axes(q + dq) - _axes(q - dq))
    n = np.einsum("ijp,jp->ip", C, v)
    dn = np.einsum("ijp,jp->ip", dC, v) + np.einsum("ijp,jp->ip", C, dv)
    V, dV = _length(v, dv)
    plane, d_plane = _length(v[[0, 2]], dv[[0, 2]])
    level, d_level = _length(n[:2], dn[:2])
    gamma, d_gamma = _angle(-n[2], level, -dn[2], d_level)
    chi, d_chi = _angle(n[1], n[0], dn[1], dn[0])
    alpha, d_alpha = _angle(v[2], v[0], dv[2], dv[0])
    beta, d_beta = _angle(v[1], plane, dv[1], d_plane)
    # The bank follows from the down components of the path's y and z axes.
    sa = np.sin(alpha)
    ca = np.cos(alpha)
    sb = np.sin(beta)
    cb = np.cos(beta)
    x_d, y_d, z_d = C[2]
    dx_d, dy_d, dz_d = dC[2]
    ahead = ca * x_d + sa * z_d
    d_ahead = ca * dx_d + sa * dz_d + d_alpha * (ca * z_d - sa * x_d)
    right = cb * y_d - sb * ahead
    d_right = cb * dy_d - sb * d_ahead - d_beta * (sb * y_d + cb * ahead)
    below = ca * z_d - sa * x_d
    d_below = ca * dz_d - sa * dx_d - d_alpha * (sa * z_d + ca * x_d)
    bank, d_bank = _angle(right, below, d_right, d_below)
    turning = x[s.ROLL_RATE : s.YAW_RATE + 1]
    d_turning = dx[s.ROLL_RATE : s.YAW_RATE + 1]
    path = np.stack([x[s.ALTITUDE], V, gamma, chi, alpha, beta, bank, *turning], axis=1)
    return path, np.stack(
        [dx[s.ALTITUDE], dV, d_gamma, d_chi, d_alpha, d_beta, d_bank, *d_turning], axis=1
    )


def _length(v: Floats, dv: Floats) -> tuple[Floats, Floats]:
    length = np.sqrt((v * v).sum(axis=0))
    return length, (v * dv).sum(axis=0) / length


def _angle(y: Floats, x: Floats, dy: Floats, dx: Floats) -> tuple[Floats, Floats]:
    return np.arctan2(y, x), (x * dy - y * dx) / (x * x + y * y)
