"""Sub-loops 3 and 4 of TLC as pure scalar functions: inverses and time-varying PI gains.

The equations are (13)-(18) of Zhu and Shen 2014 in FRD axes (x forward, y right, z down), in which
the paper's matrix element Jxy is J13: ``Hx = Jx p + J13 r``, ``Hz = Jz r + J13 p``. Each gain
matrix K (3 x 6; the column of a state follows that of its integral) gives the linearized closed
loop its prescribed dynamics: ``B K = A - A_c``, where ``A_c`` has the rows ``[-a1, -a2]`` for each
channel. Units are SI and radians.
"""

from typing import NamedTuple

from abhv_mc_vehicle.kernel.jit import scalar


class Spectrum(NamedTuple):
    """PD spectrum of a sub-loop's three channels, equation (20)."""

    a1_0: float  # wn^2
    a2_0: float  # 2 zeta wn - wn'/wn
    a1_1: float
    a2_1: float
    a1_2: float
    a2_2: float


class AttitudePoint(NamedTuple):
    """Nominal point of sub-loop 3: commanded angles, no sideslip, and forces."""

    mass_speed: float  # m V, kg m/s
    gravity_speed: float  # g / V, 1/s
    sin_alpha: float
    cos_alpha: float
    sin_bank: float
    cos_bank: float
    cos_gamma: float
    tan_gamma: float
    normal_force: float  # normal force L + T sin(alpha + e), with inclination e of the thrust line
    normal_force_slope: float  # N_alpha = L_alpha + T_alpha sin(alpha + e) + T cos(alpha + e)
    axial_thrust: float  # axial thrust T cos(alpha + e)
    side_force: float  # side force Y, wind axes
    side_force_slope: float  # Y_beta, wind axes; with drag in stability axes, q S CY_beta + D


class Inertia(NamedTuple):
    """Moments of inertia, and element 13 of the inertia matrix, kg m2."""

    xx: float
    yy: float
    zz: float
    e13: float


@scalar
def attitude_inverse(point, alpha_dot, beta_dot, bank_dot):
    """Invert eq. (13): return body rates (p, q, r) for rates of the aerodynamic angles.

    The sideslip is zero.
    """
    about_velocity = bank_dot - point.tan_gamma * (
        (point.normal_force * point.sin_bank + point.side_force * point.cos_bank) / point.mass_speed
    )
    sideways = (
        beta_dot
        - point.side_force / point.mass_speed
        - point.gravity_speed * point.cos_gamma * point.sin_bank
    )
    p = about_velocity * point.cos_alpha + sideways * point.sin_alpha
    q = (
        alpha_dot
        + point.normal_force / point.mass_speed
        - point.gravity_speed * point.cos_gamma * point.cos_bank
    )
    r = about_velocity * point.sin_alpha - sideways * point.cos_alpha
    return p, q, r


@scalar
def attitude_gains(point, p, r, spectrum):
    """Return gains K3: rows p, q, r; columns int alpha, alpha, int beta, beta, int bank, bank.

    ``p`` and ``r`` are the nominal rates from :func:`attitude_inverse`.
    """
    sa = point.sin_alpha
    ca = point.cos_alpha
    ss = point.sin_bank
    cs = point.cos_bank
    roll = p * ca + r * sa
    gravity = point.gravity_speed * point.cos_gamma
    slope = point.normal_force_slope / point.mass_speed
    normal = point.normal_force / point.mass_speed
    side = point.side_force / point.mass_speed
    side_slope = (point.side_force_slope - point.axial_thrust) / point.mass_speed

    alpha_by_alpha = -slope + spectrum.a2_0
    alpha_by_beta = -roll
    alpha_by_bank = -gravity * ss
    beta_by_alpha = roll
    beta_by_beta = side_slope + spectrum.a2_1
    beta_by_bank = gravity * cs
    bank_by_alpha = r * ca - p * sa + point.tan_gamma * slope * ss
    bank_by_beta = normal - gravity * cs + point.tan_gamma * cs * side_slope
    bank_by_bank = point.tan_gamma * (normal * cs - side * ss) + spectrum.a2_2

    # B = [[0, 1, 0], [sin a, 0, -cos a], [cos a, 0, sin a]] rotates beta and bank by alpha.
    p_by_alpha = sa * beta_by_alpha + ca * bank_by_alpha
    r_by_alpha = sa * bank_by_alpha - ca * beta_by_alpha
    p_by_beta = sa * beta_by_beta + ca * bank_by_beta
    r_by_beta = sa * bank_by_beta - ca * beta_by_beta
    p_by_bank = sa * beta_by_bank + ca * bank_by_bank
    r_by_bank = sa * bank_by_bank - ca * beta_by_bank
    return (
        (0.0, p_by_alpha, sa * spectrum.a1_1, p_by_beta, ca * spectrum.a1_2, p_by_bank),
        (spectrum.a1_0, alpha_by_alpha, 0.0, alpha_by_beta, 0.0, alpha_by_bank),
        (0.0, r_by_alpha, -ca * spectrum.a1_1, r_by_beta, sa * spectrum.a1_2, r_by_bank),
    )


@scalar
def moment_inverse(inertia, p, q, r, p_dot, q_dot, r_dot):
    """Return the moments required for angular accelerations: ``J w' + w x J w``, (17)."""
    hx = inertia.xx * p + inertia.e13 * r
    hy = inertia.yy * q
    hz = inertia.zz * r + inertia.e13 * p
    roll = inertia.xx * p_dot + inertia.e13 * r_dot + q * hz - r * hy
    pitch = inertia.yy * q_dot + r * hx - p * hz
    yaw = inertia.zz * r_dot + inertia.e13 * p_dot + p * hy - q * hx
    return roll, pitch, yaw


@scalar
def rate_gains(inertia, p, q, r, spectrum):
    """Return the gains K4 of eq. (18); the column of each rate follows that of its integral."""
    jx = inertia.xx
    jy = inertia.yy
    jz = inertia.zz
    j13 = inertia.e13
    roll_by_p = jx * spectrum.a2_0 - j13 * q
    roll_by_q = -(jz - jy) * r - j13 * p
    pitch_by_p = -(jx - jz) * r + 2.0 * j13 * p
    pitch_by_r = -(jx - jz) * p - 2.0 * j13 * r
    yaw_by_p = j13 * spectrum.a2_0 - (jy - jx) * q
    yaw_by_q = -(jy - jx) * p + j13 * r
    roll_by_r = j13 * spectrum.a2_2 - (jz - jy) * q
    yaw_by_r = jz * spectrum.a2_2 + j13 * q
    return (
        (jx * spectrum.a1_0, roll_by_p, 0.0, roll_by_q, j13 * spectrum.a1_2, roll_by_r),
        (0.0, pitch_by_p, jy * spectrum.a1_1, jy * spectrum.a2_1, 0.0, pitch_by_r),
        (j13 * spectrum.a1_0, yaw_by_p, 0.0, yaw_by_q, jz * spectrum.a1_2, yaw_by_r),
    )


@scalar
def differentiator_output(bandwidth, state, command):
    """Return the pseudo-differentiator's output (21): ``wd (u - x)``, ``x' = wd (u - x)``."""
    return bandwidth * (command - state)


@scalar
def differentiator_next(decay, state, command):
    """Return the differentiator's state after a control period, exact for a constant input.

    The result is ``x + (1 - decay)(u - x)`` with ``decay = exp(-wd tick)``.
    """
    return command + decay * (state - command)
