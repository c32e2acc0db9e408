"""Error-state navigation filter whose estimates replace the measurements of TLC or LQR.

Strapdown integration of position, velocity and attitude over the rotating WGS-84 Earth, eq. (2) of
the paper, from the measured specific force and body rates. The errors (position, velocity and
attitude in north, east, down; biases of gyros and accelerometers) are truth minus estimate; the
attitude error is a rotation vector in the local frame. Position and velocity are corrected at
``update_rate``. The growth of the errors neglects the Earth's rotation and curvature. Angle of
attack, sideslip and bank are those of the velocity relative to the Earth, so in wind they are not
the angles of the air.
"""

from collections import namedtuple
from typing import NamedTuple

from abhv_mc.extend import Filtered, atan2, matmul, measurement_filter, sincos, solve, sqrt

RADIUS, E2, GM, J2, SPIN = 6378137.0, 6.69437999014e-3, 3.986004418e14, 1.08262982e-3, 7.292115e-5


class Settings(NamedTuple):
    """Standard deviations: of measurements, of the initial attitude and of the biases."""

    update_rate: float = 1.0
    position_noise: float = 5.0
    speed_noise: float = 0.3
    flight_path_angle_noise: float = 2e-4
    heading_noise: float = 2e-4
    attitude_error: float = 2e-3
    gyro_noise: float = 2e-3  # of a sample
    gyro_bias: float = 1e-4
    acceleration_noise: float = 0.5  # of a sample
    acceleration_bias: float = 0.05


UNITS = {
    "update_rate": "Hz",
    "position_noise": "m",
    "speed_noise": "m/s",
    **dict.fromkeys(("flight_path_angle_noise", "heading_noise", "attitude_error"), "rad"),
    **dict.fromkeys(("gyro_noise", "gyro_bias"), "rad/s"),
    **dict.fromkeys(("acceleration_noise", "acceleration_bias"), "m/s2"),
}
STATE = ("latitude", "longitude", "altitude", "north", "east", "down", "q0", "q1", "q2", "q3")
VECTORS = ("gyro_bias", "acceleration_bias", "last_rate", "last_force")
BLOCKS = ("pp", "pv", "pt", "pg", "pa", "vv", "vt", "vg", "va", "tt", "tg", "ta", "gg", "ga", "aa")
FIELDS = (
    *STATE,
    *(f"{name}_{axis}" for name in VECTORS for axis in "xyz"),
    *(f"{block}_{i}{j}" for block in BLOCKS for i in range(3) for j in range(3)),
)
Memory = namedtuple("Memory", FIELDS, defaults=[0.0] * len(FIELDS))
NONE = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def radii(latitude, altitude):
    """Return metres per radian of latitude and of longitude; sine and cosine of the latitude."""
    sine, cosine = sincos(latitude)
    w2 = 1.0 - E2 * sine * sine
    normal = RADIUS / sqrt(w2)
    return normal * (1.0 - E2) / w2 + altitude, (normal + altitude) * cosine, sine, cosine


def gravity(altitude, sine, cosine):
    """Return gravity to the north and down, with J2 and the centrifugal acceleration."""
    normal = RADIUS / sqrt(1.0 - E2 * sine * sine)
    rho, z = (normal + altitude) * cosine, (normal * (1.0 - E2) + altitude) * sine
    r2 = rho * rho + z * z
    central, j2, tilt = GM / (r2 * sqrt(r2)), 1.5 * J2 * RADIUS * RADIUS / r2, 5.0 * z * z / r2
    outward = (SPIN * SPIN - central * (1.0 + j2 * (1.0 - tilt))) * rho
    along = -central * (1.0 + j2 * (3.0 - tilt)) * z
    return along * cosine - outward * sine, -(outward * cosine + along * sine)


def product(a, b):
    """Return the product of two quaternions."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def turn(x, y, z):
    """Return the quaternion of a small rotation vector."""
    squared = 0.25 * (x * x + y * y + z * z)
    half = 0.5 - squared / 12.0
    return 1.0 - 0.5 * squared, half * x, half * y, half * z


def unit(q):
    """Return a quaternion scaled to length 1."""
    k = 1.0 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return k * q[0], k * q[1], k * q[2], k * q[3]


def axes(q):
    """Return the rotation matrix from body axes to north, east, down."""
    q0, q1, q2, q3 = q
    return (
        (1.0 - 2.0 * (q2 * q2 + q3 * q3), 2.0 * (q1 * q2 - q0 * q3), 2.0 * (q1 * q3 + q0 * q2)),
        (2.0 * (q1 * q2 + q0 * q3), 1.0 - 2.0 * (q1 * q1 + q3 * q3), 2.0 * (q2 * q3 - q0 * q1)),
        (2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), 1.0 - 2.0 * (q1 * q1 + q2 * q2)),
    )


def transpose(a):
    """Return the transpose of a matrix."""
    return (
        (a[0][0], a[1][0], a[2][0]),
        (a[0][1], a[1][1], a[2][1]),
        (a[0][2], a[1][2], a[2][2]),
    )


def plus(a, k, b):
    """Return a + k b."""
    return (
        (a[0][0] + k * b[0][0], a[0][1] + k * b[0][1], a[0][2] + k * b[0][2]),
        (a[1][0] + k * b[1][0], a[1][1] + k * b[1][1], a[1][2] + k * b[1][2]),
        (a[2][0] + k * b[2][0], a[2][1] + k * b[2][1], a[2][2] + k * b[2][2]),
    )


def more(a, b, c):
    """Return a + b c."""
    return plus(a, 1.0, matmul(b, c))


def less(a, b, c):
    """Return a - b c."""
    return plus(a, -1.0, matmul(b, c))


def even(a):
    """Return the symmetric part of a matrix."""
    return plus(plus(NONE, 0.5, a), 0.5, transpose(a))


def diagonal(x, y, z):
    """Return a diagonal matrix."""
    return (x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z)


def square(m):
    """Return nine numbers, given by rows, as a matrix."""
    return (m[0], m[1], m[2]), (m[3], m[4], m[5]), (m[6], m[7], m[8])


def flat(a):
    """Return the nine numbers of a matrix by rows."""
    return a[0] + a[1] + a[2]


def velocity_of(measured, settings):
    """Return the measured velocity (north, east, down) and the covariance of its noise."""
    sin_g, cos_g = sincos(measured.flight_path_angle)
    sin_c, cos_c = sincos(measured.heading)
    speed = measured.speed
    along, across = settings.speed_noise, speed * cos_g * settings.heading_noise
    up = speed * settings.flight_path_angle_noise
    by = (
        (along * cos_g * cos_c, -across * sin_c, -up * sin_g * cos_c),
        (along * cos_g * sin_c, across * cos_c, -up * sin_g * sin_c),
        (-along * sin_g, 0.0, -up * cos_g),
    )
    velocity = speed * cos_g * cos_c, speed * cos_g * sin_c, -speed * sin_g
    return velocity, matmul(by, transpose(by))


def start(measured, settings):
    """Return estimate and covariance at the first measurement."""
    velocity, noise = velocity_of(measured, settings)
    sine, cosine = sincos(0.5 * measured.yaw)
    q = cosine, 0.0, 0.0, sine
    sine, cosine = sincos(0.5 * measured.pitch)
    q = product(q, (cosine, 0.0, sine, 0.0))
    sine, cosine = sincos(0.5 * measured.roll)
    q = product(q, (cosine, sine, 0.0, 0.0))
    p, t = settings.position_noise, settings.attitude_error
    g, a = settings.gyro_bias, settings.acceleration_bias
    position = measured.latitude, measured.longitude, measured.altitude
    blocks = (
        *(diagonal(p * p, p * p, p * p), NONE, NONE, NONE, NONE),
        *(noise, NONE, NONE, NONE, diagonal(t * t, t * t, t * t), NONE, NONE),
        *(diagonal(g * g, g * g, g * g), NONE, diagonal(a * a, a * a, a * a)),
    )
    return position + velocity + q, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), blocks


def move(memory, rate, force, dt):
    """Integrate the strapdown equations over a tick.

    Return the estimate, and the means over the tick of the rotation matrix from body axes to the
    local frame and of the specific force in the local frame.
    """
    latitude, longitude, altitude, north, east, down, q0, q1, q2, q3 = memory[:10]
    per_latitude, per_longitude, sine, cosine = radii(latitude, altitude)
    latitude_rate, longitude_rate = north / per_latitude, east / per_longitude
    w_n, w_e, w_d = (
        (SPIN + longitude_rate) * cosine,
        -latitude_rate,
        -(SPIN + longitude_rate) * sine,
    )
    before = axes((q0, q1, q2, q3))
    local_rate = matmul(transpose(before), (w_n, w_e, w_d))
    bias = memory.gyro_bias_x, memory.gyro_bias_y, memory.gyro_bias_z
    q = product(
        (q0, q1, q2, q3),
        turn(
            dt * (0.5 * (memory.last_rate_x + rate[0]) - bias[0] - local_rate[0]),
            dt * (0.5 * (memory.last_rate_y + rate[1]) - bias[1] - local_rate[1]),
            dt * (0.5 * (memory.last_rate_z + rate[2]) - bias[2] - local_rate[2]),
        ),
    )
    q = unit(q)
    b_x, b_y, b_z = (
        memory.acceleration_bias_x,
        memory.acceleration_bias_y,
        memory.acceleration_bias_z,
    )
    after = axes(q)
    f_0 = matmul(
        before, (memory.last_force_x - b_x, memory.last_force_y - b_y, memory.last_force_z - b_z)
    )
    f_1 = matmul(after, (force[0] - b_x, force[1] - b_y, force[2] - b_z))
    f = 0.5 * (f_0[0] + f_1[0]), 0.5 * (f_0[1] + f_1[1]), 0.5 * (f_0[2] + f_1[2])
    g_n, g_d = gravity(altitude, sine, cosine)
    c_n, c_e, c_d = w_n + SPIN * cosine, w_e, w_d - SPIN * sine  # Coriolis and transport
    v_n = north + dt * (f[0] + g_n - (c_e * down - c_d * east))
    v_e = east + dt * (f[1] - (c_d * north - c_n * down))
    v_d = down + dt * (f[2] + g_d - (c_n * east - c_e * north))
    moved = (
        latitude + dt * 0.5 * (north + v_n) / per_latitude,
        longitude + dt * 0.5 * (east + v_e) / per_longitude,
        altitude - dt * 0.5 * (down + v_d),
        *(v_n, v_e, v_d),
    )
    return moved + q, plus(plus(NONE, 0.5, before), 0.5, after), f


def spread(P, to_local, f, settings, dt):
    """Return the covariance after a tick."""
    pp, pv, pt, pg, pa, vv, vt, vg, va, tt, tg, ta, gg, ga, aa = P
    D = plus(NONE, -dt, to_local)
    F = ((0.0, dt * f[2], -dt * f[1]), (-dt * f[2], 0.0, dt * f[0]), (dt * f[1], -dt * f[0], 0.0))
    F_t, D_t = transpose(F), transpose(D)
    # Rows of the position, the velocity and the attitude, then the columns.
    pp, pv = plus(pp, dt, transpose(pv)), plus(pv, dt, vv)
    pt, pg, pa = plus(pt, dt, vt), plus(pg, dt, vg), plus(pa, dt, va)
    vv = more(more(vv, F, transpose(vt)), D, transpose(va))
    v_t = more(more(vt, F, tt), D, transpose(ta))
    vg, va = more(more(vg, F, tg), D, transpose(ga)), more(more(va, F, ta), D, aa)
    tt, tg, ta = more(tt, D, transpose(tg)), more(tg, D, gg), more(ta, D, ga)
    pp, pv, pt = plus(pp, dt, pv), more(more(pv, pt, F_t), pa, D_t), more(pt, pg, D_t)
    vv, vt = more(more(vv, v_t, F_t), va, D_t), more(v_t, vg, D_t)
    tt = more(tt, tg, D_t)
    q_v, q_t = dt * settings.acceleration_noise, dt * settings.gyro_noise
    vv = plus(vv, 1.0, diagonal(q_v * q_v, q_v * q_v, q_v * q_v))
    tt = plus(tt, 1.0, diagonal(q_t * q_t, q_t * q_t, q_t * q_t))
    return pp, pv, pt, pg, pa, vv, vt, vg, va, tt, tg, ta, gg, ga, aa


def correct(P, row, S, z):
    """Return covariance and errors after a measurement of three errors.

    ``row`` contains the blocks of P that belong to these errors; ``z`` and ``S`` are the innovation
    and its covariance.
    """
    inverse = solve(S, diagonal(1.0, 1.0, 1.0))
    p, v, t = matmul(inverse, row[0]), matmul(inverse, row[1]), matmul(inverse, row[2])
    g, a = matmul(inverse, row[3]), matmul(inverse, row[4])
    p_t, v_t, t_t = transpose(row[0]), transpose(row[1]), transpose(row[2])
    g_t, a_t = transpose(row[3]), transpose(row[4])
    blocks = (
        *(even(less(P[0], p_t, p)), less(P[1], p_t, v), less(P[2], p_t, t), less(P[3], p_t, g)),
        *(less(P[4], p_t, a), even(less(P[5], v_t, v)), less(P[6], v_t, t), less(P[7], v_t, g)),
        *(less(P[8], v_t, a), even(less(P[9], t_t, t)), less(P[10], t_t, g), less(P[11], t_t, a)),
        *(even(less(P[12], g_t, g)), less(P[13], g_t, a), even(less(P[14], a_t, a))),
    )
    return (
        blocks,
        matmul(transpose(p), z) + matmul(transpose(v), z) + matmul(transpose(t), z),
        matmul(transpose(g), z),
        matmul(transpose(a), z),
    )


def add(a, b):
    """Return the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def apply(x, d):
    """Return the estimate corrected by its errors."""
    per_latitude, per_longitude, _, _ = radii(x[0], x[2])
    q = unit(product(turn(d[6], d[7], d[8]), x[6:10]))
    position = x[0] + d[0] / per_latitude, x[1] + d[1] / per_longitude, x[2] - d[2]
    return position + add(x[3:6], d[3:6]) + q


def update(x, gyro, bias, P, measured, settings):
    """Return estimate and covariance after a measurement of position and velocity."""
    per_latitude, per_longitude, _, _ = radii(x[0], x[2])
    p = settings.position_noise
    z = (
        (measured.latitude - x[0]) * per_latitude,
        (measured.longitude - x[1]) * per_longitude,
        x[2] - measured.altitude,
    )
    S = plus(P[0], 1.0, diagonal(p * p, p * p, p * p))
    P, d, d_g, d_a = correct(P, P[0:5], S, z)
    x, gyro, bias = apply(x, d), add(gyro, d_g), add(bias, d_a)
    velocity, noise = velocity_of(measured, settings)
    z = velocity[0] - x[3], velocity[1] - x[4], velocity[2] - x[5]
    row = transpose(P[1]), P[5], P[6], P[7], P[8]
    P, d, d_g, d_a = correct(P, row, plus(P[5], 1.0, noise), z)
    return apply(x, d), add(gyro, d_g), add(bias, d_a), P


def covariance(m):
    """Return the blocks of the covariance from a memory."""
    return (
        *(square(m[22:31]), square(m[31:40]), square(m[40:49]), square(m[49:58])),
        *(square(m[58:67]), square(m[67:76]), square(m[76:85]), square(m[85:94])),
        *(square(m[94:103]), square(m[103:112]), square(m[112:121]), square(m[121:130])),
        *(square(m[130:139]), square(m[139:148]), square(m[148:157])),
    )


@measurement_filter(units=UNITS)
def law(measured, memory, settings, time, dt):
    """Return the filtered measurement for the controller, and the memory."""
    rate = measured.roll_rate, measured.pitch_rate, measured.yaw_rate
    force = measured.acceleration_x, measured.acceleration_y, measured.acceleration_z
    if time == 0.0:
        x, gyro, bias, P = start(measured, settings)
    else:
        x, to_local, f = move(memory, rate, force, dt)
        gyro, bias = memory[10:13], memory[13:16]
        P = spread(covariance(memory), to_local, f, settings, dt)
        count = int(time * settings.update_rate + 1e-6)
        if count > int((time - dt) * settings.update_rate + 1e-6):
            x, gyro, bias, P = update(x, gyro, bias, P, measured, settings)
    level = sqrt(x[3] * x[3] + x[4] * x[4])
    to_body = transpose(axes(x[6:10]))
    u, v, w = matmul(to_body, x[3:6])
    down_x, down_y, down_z = to_body[0][2], to_body[1][2], to_body[2][2]
    plane = sqrt(u * u + w * w)
    # components of the vertical along the y and z wind axes, times the same factor
    down = plane * plane * down_y - v * (u * down_x + w * down_z), u * down_z - w * down_x
    filtered = Filtered(
        altitude=x[2],
        speed=sqrt(level * level + x[5] * x[5]),
        flight_path_angle=atan2(-x[5], level),
        heading=atan2(x[4], x[3]),
        angle_of_attack=atan2(w, u),
        sideslip=atan2(v, plane),
        bank=atan2(down[0], sqrt(plane * plane + v * v) * down[1]),
        roll_rate=rate[0] - gyro[0],
        pitch_rate=rate[1] - gyro[1],
        yaw_rate=rate[2] - gyro[2],
    )
    numbers = x + gyro + bias + rate + force
    numbers = numbers + flat(P[0]) + flat(P[1]) + flat(P[2]) + flat(P[3]) + flat(P[4])
    numbers = numbers + flat(P[5]) + flat(P[6]) + flat(P[7]) + flat(P[8]) + flat(P[9])
    numbers = numbers + flat(P[10]) + flat(P[11]) + flat(P[12]) + flat(P[13]) + flat(P[14])
    return filtered, Memory(*numbers)
